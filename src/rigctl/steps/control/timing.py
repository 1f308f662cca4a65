"""Timing statistics of a loop, stored with the record."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field


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
