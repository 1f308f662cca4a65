"""What fitted numbers become over the ranges of the assumed ones, where the data do not fix these.

With a an assumed number and x a fitted one, the fit's covariance C gives how x follows a where the data
leave it open: ``dx/da = C_xa/C_aa``, and the standard deviation of x at a given a,
``s² = C_xx - C_xa²/C_aa``. Over a range of a factor a straight line is a bad guide: positive numbers follow a
power of a with that slope, which is exact where only products of the two act.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.undetermined import unit_of
from rigctl.model.value_table import rounded
from rigctl.units import parse_unit, show, significant

#: an assumed number that the data determine better than this share of its prior no longer matters
_DETERMINED = 0.5
#: standard deviations about the ends of the range
_SPREADS = 2.0
#: no physical quantity goes with such a power of another one
_STEEPEST = 8.0


@dataclass(frozen=True)
class Assumption:
    """An assumed number that these data leave open: its value in the fit and its range, SI."""

    parameter: str
    value: float
    low: float
    high: float
    unit: str

    def document(self) -> dict[str, Any]:
        """Its machine-readable form, in `unit`."""
        unit = parse_unit(self.unit)
        low, value, high = (rounded(unit.from_si(one)) for one in (self.low, self.value, self.high))
        return {"parameter": self.parameter, "value": value, "range": [low, high], "unit": self.unit}


@dataclass(frozen=True)
class Conditional:
    """A fitted number that holds only for assumed ones.

    Attributes
    ----------
    std: its standard deviation if the assumed values are right, SI.
    low, high: what it may be over their ranges, SI, two standard deviations included.
    """

    assumptions: tuple[Assumption, ...]
    std: float
    low: float
    high: float

    @property
    def given(self) -> str:
        """``if resistance = 2 ohm (assumed)``."""
        values = " and ".join(f"{one.parameter} = {show(one.value, one.unit)}" for one in self.assumptions)
        return f"if {values} (assumed)"

    def clause(self, unit: str) -> str:
        """``if resistance = 2 ohm (assumed); 0.003 to 0.012 over its range``, in `unit`."""
        low, high = (significant(parse_unit(unit).from_si(one), 2) for one in (self.low, self.high))
        its = "its range" if len(self.assumptions) == 1 else "their ranges"
        return f"{self.given}; {low} to {high} over {its}"

    def document(self, unit: str) -> dict[str, Any]:
        """Its machine-readable form, with `over_range` in `unit`."""
        ends = [rounded(parse_unit(unit).from_si(one)) for one in (self.low, self.high)]
        return {"depends_on": [one.document() for one in self.assumptions], "over_range": ends}


def conditional_document(one: Conditional | None, unit: str) -> dict[str, Any]:
    """The fields of a fitted number on what it depends on; nothing is assumed of most."""
    return {"depends_on": [], "over_range": None} if one is None else one.document(unit)


def conditional_numbers(fitted: FitResult) -> dict[str, Conditional]:
    """The fitted numbers that follow assumed ones which these data do not fix, by name."""
    open_numbers = _left_open(fitted)
    if not open_numbers or fitted.solution is None:
        return {}
    # all open numbers together: the slopes are those of a regression on them, C_xa·C_aa⁻¹, as two assumed
    # numbers may be correlated by the data
    names = [one.name for one in fitted.problem.shared]
    covariance = fitted.reported_covariance
    wanted = [*fitted.problem.model.fitted]
    found = {}
    for name in (one for one in wanted if one in names and one not in fitted.at_bound):
        x = names.index(name)
        at = [names.index(one.parameter) for one in open_numbers]
        row = covariance[x, at]
        if not np.isfinite(covariance[x, x]):
            continue
        # what x varies by once they are given; only numbers that move x by more than that are worth a
        # condition
        slopes = np.linalg.lstsq(covariance[np.ix_(at, at)], row, rcond=None)[0]
        std = math.sqrt(max(float(covariance[x, x] - slopes @ row), 0.0))
        followed = [
            (one, float(slope))
            for one, slope, k in zip(open_numbers, slopes, at, strict=True)
            if abs(slope) * math.sqrt(covariance[k, k]) > std
        ]
        if followed:
            low, high = over_range(float(fitted.values[x]), std, followed)
            found[name] = Conditional(tuple(one for one, _ in followed), std, low, high)
    return found


def _left_open(fitted: FitResult) -> list[Assumption]:
    """The assumed numbers that the data determine hardly better than their ranges do."""
    result = []
    for unknown, value in zip(fitted.problem.shared, fitted.values.tolist(), strict=True):
        limits = fitted.problem.model.assumed.get(unknown.name)
        std = fitted.reported_std.get(unknown.name, 0.0)
        if limits is None or unknown.prior is None or std <= _DETERMINED * unknown.prior.std:
            continue
        result.append(Assumption(unknown.name, value, *limits, unit_of(fitted, unknown.name)))
    return result


def over_range(x: float, std: float, followed: Sequence[tuple[Assumption, float]]) -> tuple[float, float]:
    """The least and the greatest value of a fitted x over the ranges of what it follows, with two standard
    deviations; each of `followed` with the slope of x."""
    values = [x]
    for one, slope in followed:
        values = [_at(value, x, one, slope, to) for value in values for to in (one.low, one.high)]
    spreads = [_SPREADS * std * max(1.0, abs(value / x) if x else 1.0) for value in values]
    low = min(value - spread for value, spread in zip(values, spreads, strict=True))
    return low, max(value + spread for value, spread in zip(values, spreads, strict=True))


def _at(value: float, x: float, one: Assumption, slope: float, to: float) -> float:
    """What `value` becomes where an assumed number goes `to` an end of its range, x being the fitted one.

    By the power law of their slope, ``x ∝ a^k``, as products and quotients follow each other. The slope of a
    small difference of others shows no power: it follows as a line.
    """
    power = slope * one.value / x if x != 0.0 else math.inf
    if one.value * to > 0.0 and abs(power) < _STEEPEST:
        return value * float((to / one.value) ** power)
    return value + slope * (to - one.value)
