"""One record of a family in which every effect of its library shows: what an effect is drawn on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class StandardRecord:
    """The commands and their times.

    Attributes
    ----------
    description: for people.
    times: of the samples, in s.
    switches: times and the inputs that change at each, SI; what is not named keeps its value, at first the
        family's usual one. The first is at the start.
    initial: of the states that do not start as the family's usually do, SI.
    """

    description: str
    times: tuple[float, ...]
    switches: tuple[tuple[float, Mapping[str, float]], ...]
    initial: Mapping[str, float] = field(default_factory=dict)


def grid(end: float, step: float, first: float = 0.0) -> tuple[float, ...]:
    """Times from `first` to `end`, both included, every `step` seconds."""
    return tuple(first + step * index for index in range(round((end - first) / step) + 1))
