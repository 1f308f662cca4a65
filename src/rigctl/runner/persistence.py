"""How long a signal has been outside its band: without a break, or as a share of the newest readings.

A loose wire, a sensor that is failing or a value that swings about its limit are inside again and again. If
one reading inside were enough to start the time anew, they would never trip an interlock.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

_SLACK = 1e-9  # s; times on a sampling grid are sums of rounded numbers
#: fewest readings outside that count as a share, since single ones are spikes
_FEWEST = 3
#: length of the window in readings, where that is longer than the window in s
_READINGS = 8


@dataclass(slots=True)
class Persistence:
    """The readings of one signal, and whether they have been outside for long enough.

    Outside for `duration` s without a break is long enough; so are at least `_FEWEST` readings outside that
    make up ``duration / window`` of the time in the last `window` s, or of the last `_READINGS` readings if
    these take longer. A reading holds until the next one; time before the first reading outside counts as
    inside. Nothing is added for a missing value: what was true before it holds on.

    Parameters
    ----------
    duration: s; 0: a single reading is long enough.
    window: s, at least `duration`.
    """

    duration: float
    window: float
    since: float | None = None  #: s, first reading outside after the newest one inside
    _recent: deque[tuple[float, bool]] = field(default_factory=deque)
    _outside: int = 0  # readings outside among the recent ones
    _time_outside: float = 0.0  # s, of the intervals between them

    @property
    def calm(self) -> bool:
        """True if no reading was outside within the window."""
        return not self._recent

    @property
    def share(self) -> tuple[int, int]:
        """Number of recent readings outside, and of all since the first of them."""
        return self._outside, len(self._recent)

    def inside(self, time: float) -> None:
        """Take a reading inside the band."""
        self.since = None
        if self._recent:
            self._add(time, outside=False)

    def outside(self, time: float) -> bool:
        """Take a reading outside; returns whether they have been outside for long enough."""
        if self.since is None:
            self.since = time
        window = self._add(time, outside=True)
        if self.unbroken(time):
            return True
        share = self.duration / self.window
        return self._outside >= _FEWEST and self._time_outside >= share * window - _SLACK

    def unbroken(self, time: float) -> bool:
        """Whether every reading of the last `duration` s was outside."""
        return self.since is not None and time - self.since >= self.duration - _SLACK

    def _add(self, time: float, *, outside: bool) -> float:
        """Add a reading, and forget those before the window; returns its length, s."""
        recent = self._recent
        step = time - recent[-1][0] if recent else 0.0
        # The previous reading holds until this one: its interval counts as it was.
        if recent and recent[-1][1]:
            self._time_outside += step
        recent.append((time, outside))
        self._outside += outside
        # Of slow readings so many are taken that a share means something.
        window = max(self.window, _READINGS * step)
        begin = time - window - _SLACK
        while recent[0][0] < begin:
            then, was_outside = recent.popleft()
            self._outside -= was_outside
            if was_outside:
                self._time_outside -= recent[0][0] - then
        # Calm again: as long as everything is inside, nothing is kept and nothing computed.
        if not self._outside:
            recent.clear()
            self._time_outside = 0.0
        return window
