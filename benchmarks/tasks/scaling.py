"""How far handing out pieces one by one carries: a simulation of one scheduler and many workers."""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass


@dataclass(frozen=True)
class Scheduler:
    """What one piece costs whoever hands it out, and how many each worker has at a time, s."""

    per_piece: float = 1e-3
    ahead: int = 2


def efficiency(workers: int, lasts: float, scheduler: Scheduler, pieces_each: int = 50) -> float:
    """The work done over what so many workers could have done in the time that it took.

    Pieces last as fits do, some twice as long as others (lognormal, a standard deviation of half the mean).
    The scheduler does one thing at a time: it hands out a piece when a worker has fewer than `ahead`.
    """
    chance = random.Random(workers)
    sigma = 0.47  # of the logarithm: half the mean
    pieces = [lasts * chance.lognormvariate(-0.5 * sigma**2, sigma) for _ in range(workers * pieces_each)]
    free_at = [0.0] * workers  # when each has done what it was given
    asks = [(0.0, worker) for worker in range(workers) for _ in range(scheduler.ahead)]
    heapq.heapify(asks)
    clock = 0.0
    for piece in pieces:
        asked, worker = heapq.heappop(asks)
        clock = max(clock, asked) + scheduler.per_piece
        began = max(clock, free_at[worker])
        free_at[worker] = began + piece
        # it asks for one more when it begins the one that it has in hand
        heapq.heappush(asks, (free_at[worker] if scheduler.ahead == 1 else began, worker))
    return sum(pieces) / (workers * max(free_at))
