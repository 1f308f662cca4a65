"""When a loop on the host is updated, and the statistics of it, stored with the record."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

#: fraction of the loop's period by which an update may be early, since times on the sampling grid are rounded
EARLY = 0.01
_ROUNDING = 1e-9


@dataclass
class Cadence:
    """Choose the readings at which a loop is updated: those nearest to the multiples of its period.

    Readings of a device that is asked for them come a little early or late, each by itself. A loop that
    waited for a whole period since its last update would find every reading that follows a late one too
    early, and leave it out, so that the output would stand still for two periods. Hence due times are those
    of a grid, and the reading that is next to one of them counts, however late the one before was:

        |t − t_due| < T_s / 2,   t_due ← t_due + T

    After a gap the grid begins anew at the next reading: no updates are made up for.

    Parameters
    ----------
    period: the loop's, T, s.
    shortest: the shortest time between two commands of the actuator, s.
    """

    period: float
    shortest: float = 0.0
    _due: float = -math.inf
    _last: float = -math.inf

    def is_due(self, time: float, spacing: float) -> bool:
        """Return whether the reading at `time`, s, is one of those, and remember it.

        One reading comes every `spacing` T_s, s.
        """
        # One update may be late by this and the next one early: the actuator's shortest interval holds then,
        # too, but for the rounding of the times of a grid.
        near = max(0.5 * min(spacing, self.period - self.shortest), EARLY * self.period)
        near *= 1.0 + _ROUNDING  # of two readings that are equally near it is the first
        # Rows of other devices repeat a reading: it counts once.
        if time < self._due - near or time <= self._last:
            return False
        self._last = time
        self._due = (self._due if time < self._due + near else time) + self.period
        return True


@dataclass
class Timing:
    """The times of a loop's updates, and their statistics.

    *Jitter* is the absolute deviation of the time between two commands from the loop's period; *latency* is
    the time from a reading to the sending of the command that follows from it.
    """

    period: float  #: s
    saturated: int = 0  #: updates whose output was saturated
    missed: int = 0  #: readings that could not be used
    _acted: list[float] = field(default_factory=list)
    _latency: list[float] = field(default_factory=list)

    def add(self, read: float, acted: float, *, saturated: bool) -> None:
        """Add an update: the times of the reading and of its command, s."""
        self._acted.append(acted)
        self._latency.append(acted - read)
        self.saturated += saturated

    @property
    def updates(self) -> int:
        """The number of updates."""
        return len(self._acted)

    def values(self) -> Iterator[tuple[str, float, str]]:
        """Yield the values to be stored: name, SI value, unit for display."""
        jitter = sorted(
            abs(later - earlier - self.period)
            for earlier, later in zip(self._acted, self._acted[1:], strict=False)
        )
        latency = sorted(self._latency)
        if jitter:
            yield "jitter_p50", _quantile(jitter, 0.5), "ms"
            yield "jitter_p99", _quantile(jitter, 0.99), "ms"
            yield "jitter_max", jitter[-1], "ms"
        if latency:
            yield "latency_p99", _quantile(latency, 0.99), "ms"
            yield "saturated", self.saturated / len(latency), "%"


def _quantile(ordered: list[float], share: float) -> float:
    """Return a quantile of sorted values by the nearest-rank method."""
    rank = max(-(-len(ordered) * round(share * 1000) // 1000), 1)
    return ordered[rank - 1]
