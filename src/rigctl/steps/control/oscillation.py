"""Detects that a loop oscillates instead of settling."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

#: number of half periods that are examined: five cycles
_HALVES: Final = 10
#: smallest ratio of the peaks in their second half to those in the first half for a sustained oscillation
_LASTING: Final = 0.8
#: largest relative deviation of the half periods from their median; those due to noise deviate more
_REGULAR: Final = 0.5


class OscillationDetector:
    """Monitors the control error between its changes of sign (after Hägglund, 1995).

    A sustained oscillation consists of ten consecutive half periods of similar length whose peaks are all at
    least `amplitude` and do not decay.
    """

    def __init__(self, amplitude: float) -> None:
        self._amplitude = amplitude
        self._halves: deque[tuple[float, float]] = deque(maxlen=_HALVES)  # length in s, peak
        self._sign = 0.0
        self._began = 0.0
        self._peak = 0.0

    def add(self, time: float, error: float) -> tuple[float, float] | None:
        """Add the error at a time; return amplitude and period (s) of a sustained oscillation, or None."""
        # An error of exactly zero belongs to the half period in progress.
        sign = math.copysign(1.0, error) if error != 0.0 else self._sign
        if sign == self._sign:
            self._peak = max(self._peak, abs(error))
            return None
        # The first half period began before the loop was watched: its length is unknown.
        if self._sign != 0.0:
            self._finish(time - self._began)
        self._sign, self._began, self._peak = sign, time, abs(error)
        return self._found()

    def _finish(self, length: float) -> None:
        """Add a completed half period; one with a small peak resets the detection."""
        if self._peak < self._amplitude:
            self._halves.clear()
        else:
            self._halves.append((length, self._peak))

    def _found(self) -> tuple[float, float] | None:
        if len(self._halves) < _HALVES:
            return None
        lengths = sorted(length for length, _ in self._halves)
        median = 0.5 * (lengths[_HALVES // 2 - 1] + lengths[_HALVES // 2])
        # Noise about the set-point changes its sign too, but irregularly.
        if lengths[-1] > (1.0 + _REGULAR) * median or lengths[0] < (1.0 - _REGULAR) * median:
            return None
        peaks = [peak for _, peak in self._halves]
        first, second = sum(peaks[: _HALVES // 2]), sum(peaks[_HALVES // 2 :])
        # A loop that settles oscillates as well, with peaks that become smaller.
        if second < _LASTING * first:
            return None
        return second / (_HALVES // 2), 2.0 * median
