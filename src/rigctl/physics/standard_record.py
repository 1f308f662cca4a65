"""A record of a family in which every effect of its library is visible; effects are plotted on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class StandardRecord:
    """The commands and their times.

    Attributes
    ----------
    description: for a reader.
    times: of the samples, in s.
    switches: times, the first of which is the start, and the inputs set at each, SI. Other inputs keep
        their values, initially the family's defaults.
    initial: of the states that do not start at the family's default, SI.
    """

    description: str
    times: tuple[float, ...]
    switches: tuple[tuple[float, Mapping[str, float]], ...]
    initial: Mapping[str, float] = field(default_factory=dict)


def grid(end: float, step: float, first: float = 0.0) -> tuple[float, ...]:
    """Times from `first` to `end`, both included, every `step` seconds."""
    return tuple(first + step * index for index in range(round((end - first) / step) + 1))
