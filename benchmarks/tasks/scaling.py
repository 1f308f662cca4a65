"""The scaling of distributing single tasks: a simulation of one scheduler and many workers."""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass


@dataclass(frozen=True)
class Scheduler:
    """The cost of one task for the scheduler, s, and the number of tasks per worker at a time."""

    per_piece: float = 1e-3
    ahead: int = 2


def efficiency(workers: int, lasts: float, scheduler: Scheduler, pieces_each: int = 50) -> float:
    """The work done as a share of what the workers could have done in the same time.

    Task durations vary as those of fits (lognormal, with a standard deviation of half the mean). The
    scheduler does one thing at a time: it distributes a task when a worker has fewer than `ahead`.
    """
    chance = random.Random(workers)
    sigma = 0.47  # of the logarithm: half the mean
    pieces = [lasts * chance.lognormvariate(-0.5 * sigma**2, sigma) for _ in range(workers * pieces_each)]
    free_at = [0.0] * workers  # when each worker has finished its tasks
    asks = [(0.0, worker) for worker in range(workers) for _ in range(scheduler.ahead)]
    heapq.heapify(asks)
    clock = 0.0
    for piece in pieces:
        asked, worker = heapq.heappop(asks)
        clock = max(clock, asked) + scheduler.per_piece
        began = max(clock, free_at[worker])
        free_at[worker] = began + piece
        # it requests one more when it starts the current one
        heapq.heappush(asks, (free_at[worker] if scheduler.ahead == 1 else began, worker))
    return sum(pieces) / (workers * max(free_at))
