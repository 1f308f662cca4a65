"""How evenly a loop ran: kept with the record, so that nobody has to believe it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field


@dataclass
class Timing:
    """The instants at which a loop has acted.

    *Jitter* is by how much the time between two commands differs from the loop's period; *latency* is the
    time from when a reading was taken until its command was handed to the bench.
    """

    period: float  #: s
    saturated: int = 0  #: updates whose output was bounded
    missed: int = 0  #: readings that could not be used
    _acted: list[float] = field(default_factory=list)
    _latency: list[float] = field(default_factory=list)

    def add(self, read: float, acted: float, *, saturated: bool) -> None:
        """An update: when the reading was taken and when it was acted on, s."""
        self._acted.append(acted)
        self._latency.append(acted - read)
        self.saturated += saturated

    @property
    def updates(self) -> int:
        """How many there were."""
        return len(self._acted)

    def values(self) -> Iterator[tuple[str, float, str]]:
        """What is kept: name, SI value, unit that it is shown in."""
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
    """The nearest rank: the smallest value that so many are not above."""
    rank = max(-(-len(ordered) * round(share * 1000) // 1000), 1)
    return ordered[rank - 1]
