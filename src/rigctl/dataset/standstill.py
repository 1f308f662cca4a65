"""Stretches in which a channel repeats one value exactly, although its noise changes it at every sample.

Let a share p of the steps between other consecutive readings be zero. A stretch of L equal readings then
begins at any of n readings with probability p^(L−1) by chance. If n p^(L−1) < `CHANCE`, it is no coincidence:
the sensor, or the logger, repeated its last value. Channels that mostly repeat their values anyway, behind a
coarse converter or at rest, say nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: expected number of such stretches in a record by chance
CHANCE: Final = 1e-6
#: largest share of equal steps of a channel whose standstill says something
_MOSTLY: Final = 0.5
#: fewest readings of a stretch
_FEWEST: Final = 8


@dataclass(frozen=True)
class Standstill:
    """`readings` equal readings, from `begin` to `end`, s, of `value`."""

    readings: int
    begin: float
    end: float
    value: float


class StandstillDetector:
    """Finds the longest stretch of equal readings of one channel in one record, added piece by piece."""

    def __init__(self) -> None:
        self._open = Standstill(0, np.nan, np.nan, np.nan)  # the stretch that the newest reading is part of
        self._longest = self._open
        self._readings = 0
        self._equal = 0  # steps of zero

    def add(self, times: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        """Add the next readings; missing ones (NaN) are left out."""
        present = np.isfinite(values)
        times, values = times[present], values[present]
        if not values.size:
            return
        last = self._open
        starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
        ends = np.append(starts[1:], values.size)
        lengths = ends - starts
        self._readings += int(values.size)
        self._equal += int((lengths - 1).sum())
        for index in {0, int(lengths.argmax()), len(starts) - 1}:
            length, begin = int(lengths[index]), float(times[starts[index]])
            value, end = float(values[starts[index]]), float(times[ends[index] - 1])
            if index == 0 and value == last.value:
                self._equal += 1
                length, begin = length + last.readings, last.begin
            stretch = Standstill(length, begin, end, value)
            if length > self._longest.readings:
                self._longest = stretch
            if index == len(starts) - 1:
                self._open = stretch

    def found(self) -> Standstill | None:
        """Return the longest stretch, if it is no coincidence."""
        longest = self._longest
        others = self._readings - longest.readings
        if longest.readings < _FEWEST or others < longest.readings:  # it rests most of the time
            return None
        share = (self._equal - (longest.readings - 1) + 1.0) / (others + 2.0)
        expected = self._readings * min(share, 1.0) ** (longest.readings - 1)
        return longest if share <= _MOSTLY and expected < CHANCE else None


def find_standstill(times: NDArray[np.float64], values: NDArray[np.float64]) -> Standstill | None:
    """Return the longest stretch of equal readings of a record that is no coincidence; None without one."""
    detector = StandstillDetector()
    detector.add(times, values)
    return detector.found()
