"""A rate with its Wilson bounds, and all the figures of a tier."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from rigctl_validation.outcome import TrialOutcome

Trial = TypeVar("Trial")
#: two-sided 95 %
_Z = 1.959963984540054


@dataclass(frozen=True)
class Rate:
    """The frequency of an event.

    Attributes
    ----------
    name, of: what is counted, among which trials.
    low, high: Wilson bounds at 95 %.
    at_least, at_most: the target; None if there is no such bound.
    """

    name: str
    of: str
    count: int
    trials: int
    at_least: float | None = None
    at_most: float | None = None

    @property
    def value(self) -> float:
        """The share; NaN without trials."""
        return self.count / self.trials if self.trials else math.nan

    @property
    def low(self) -> float:
        """Lower Wilson bound."""
        return wilson(self.count, self.trials)[0]

    @property
    def high(self) -> float:
        """Upper Wilson bound."""
        return wilson(self.count, self.trials)[1]

    @property
    def met(self) -> bool | None:
        """Whether the share reaches its target; None without a target or without trials."""
        if not self.trials or (self.at_least is None and self.at_most is None):
            return None
        enough = self.at_least is None or self.value >= self.at_least
        return enough and (self.at_most is None or self.value <= self.at_most)

    def document(self) -> dict[str, Any]:
        """The rate as plain data."""
        return {
            "name": self.name,
            "of": self.of,
            "count": self.count,
            "trials": self.trials,
            "value": self.value if self.trials else None,
            "low": self.low,
            "high": self.high,
            "at_least": self.at_least,
            "at_most": self.at_most,
            "met": self.met,
        }


def wilson(count: int, trials: int, z: float = _Z) -> tuple[float, float]:
    """Wilson's interval of a share: (p + z²/2n ± z·√(p(1 − p)/n + z²/4n²))/(1 + z²/n); (0, 1) without trials.

    Source: Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if not trials:
        return 0.0, 1.0
    share, square = count / trials, z * z / trials
    half = z * math.sqrt(share * (1.0 - share) / trials + square / (4.0 * trials))
    centre = share + square / 2.0
    return max(0.0, (centre - half) / (1.0 + square)), min(1.0, (centre + half) / (1.0 + square))


def rate_of(
    name: str,
    of: str,
    among: Sequence[Trial],
    happened: Callable[[Trial], bool],
    *,
    at_least: float | None = None,
    at_most: float | None = None,
) -> Rate:
    """The frequency of an event among trials."""
    return Rate(name, of, sum(map(happened, among)), len(among), at_least, at_most)


@dataclass(frozen=True)
class Figures:
    """All results of a tier that are printed.

    Attributes
    ----------
    confusion: by hidden effect, how often each answer was given; the right answer has the name of the row.
    listing: the heading and the rows of a table of single trials; empty where there are too many of them.
    """

    outcomes: tuple[TrialOutcome[Any], ...]
    rates: tuple[Rate, ...]
    confusion: Mapping[str, Mapping[str, int]]
    listing: tuple[tuple[str, ...], ...] = ()

    def document(self) -> dict[str, Any]:
        """The figures as plain data."""
        outcomes = self.outcomes
        return {
            "scenarios": len(outcomes),
            "untested": [{"scenario": o.scenario.name, "why": o.untested} for o in outcomes if o.untested],
            "failed": [{"scenario": o.scenario.name, "why": o.failure} for o in outcomes if o.failure],
            "rates": [rate.document() for rate in self.rates],
            "confusion": {truth: dict(named) for truth, named in self.confusion.items()},
            "listing": [dict(zip(self.listing[0], row, strict=True)) for row in self.listing[1:]],
            "seconds": sum(outcome.seconds for outcome in outcomes),
        }
