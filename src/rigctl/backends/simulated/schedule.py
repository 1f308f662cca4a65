"""The scheduled events of the simulated bench, in order of time."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from itertools import count

#: called with the exact time of the event
Action = Callable[[float], None]


class Schedule:
    """Actions at exact times; simultaneous ones run in the order in which they were added."""

    def __init__(self) -> None:
        self._queue: list[tuple[float, int, bool, Action]] = []
        self._number = count()
        #: time of the first action; infinite without one
        self.next_time = math.inf

    def add(self, time: float, action: Action, *, commanded: bool = False) -> int:
        """Schedule `action` at `time`; return its number, for `drop`."""
        number = next(self._number)
        heapq.heappush(self._queue, (time, number, commanded, action))
        self.next_time = self._queue[0][0]
        return number

    def take(self) -> tuple[float, Action]:
        """Remove the first action and return it with its time."""
        time, _, _, action = heapq.heappop(self._queue)
        self.next_time = self._queue[0][0] if self._queue else math.inf
        return time, action

    def drop(self, number: int) -> None:
        """Remove the action with this number."""
        self._keep([entry for entry in self._queue if entry[1] != number])

    def drop_commands(self) -> None:
        """Remove all actions that were scheduled by commands."""
        self._keep([entry for entry in self._queue if not entry[2]])

    def _keep(self, entries: list[tuple[float, int, bool, Action]]) -> None:
        heapq.heapify(entries)
        self._queue = entries
        self.next_time = entries[0][0] if entries else math.inf
