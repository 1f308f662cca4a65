"""Which template a log suggests: the simplest one whose linear system explains it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigctl.proposal.columns import Table
from rigctl.proposal.from_columns import chosen
from rigctl.proposal.responses import (
    Response,
    driven_mass_response,
    first_order_response,
    second_order_response,
    static_response,
    tells_no_directions,
)
from rigctl.units import is_angle, parse_unit

#: a system with one more pole must leave at most this share of what a simpler one leaves
_MUCH_LESS: Final = 0.3
#: a lag below this many samples hardly shows
_FAST: Final = 5.0
#: a straight line may leave this much more than such a lag
_AS_GOOD: Final = 1.5
#: what a system that explains a log well leaves at most
_WELL: Final = 0.05
#: what is worth another try, of what a fit left
WORTH: Final = 0.5


@dataclass(frozen=True)
class Suggestion:
    """What the linear systems leave of a log.

    Attributes
    ----------
    template: the simplest that explains it.
    unexplained: by template, the share of the variance of its outputs, their mean.
    """

    template: str
    unexplained: Mapping[str, float]

    def better_than(self, template: str, left: float) -> str | None:
        """The template that leaves the least, if that is much less than `left`; None if none does."""
        others = {name: share for name, share in self.unexplained.items() if name != template}
        best = min(others, key=others.__getitem__, default=None)
        return best if best is not None and others[best] < WORTH * left else None


def suggest(table: Table) -> Suggestion:
    """The template for a log; without time a straight line, without data a first-order lag."""
    # What each linear system leaves of the outputs' variance, the simplest system first. Without time, or
    # with a log too short for a lag, there is nothing to choose by.
    inputs, outputs = chosen(table, "input"), chosen(table, "output")
    if table.times is None:
        return Suggestion("linear", {})
    lags = [first_order_response(table, y, inputs) for y in outputs]
    if not outputs or any(lag is None for lag in lags):
        return Suggestion("first-order", {})
    left = {"first-order": _mean(lags)}
    statics = [static_response(table, y, inputs) for y in outputs]
    if all(statics):
        left["linear"] = _mean(statics)
    if len(outputs) == 1:
        left["second-order"] = _mean([second_order_response(table, outputs[0], inputs)])
        # A sensor without a sign (a speed from pulses) makes any linear system fail: tried before they are
        # compared.
        unsigned = tells_no_directions(table, outputs[0], inputs)
        if unsigned is not None:
            return Suggestion("second-order", left | {"second-order": unsigned.unexplained})
        moved = is_angle(outputs[0].unit) or outputs[0].display.dimension == parse_unit("m").dimension
        if moved and len(inputs) == 1:
            left["driven-mass"] = _mean([driven_mass_response(table, outputs[0], inputs)])
    slowest = max(1.0 / lag.rates[0] for lag in lags if lag is not None)
    steady = not any(u.origin == "commanded" for u in inputs)
    return Suggestion(_simplest(left, slowest / _step(table), steady=steady), left)


def _simplest(left: Mapping[str, float], samples: float, *, steady: bool) -> str:
    """The template for these shares.

    Parameters
    ----------
    samples: the slowest lag, in sampling intervals.
    steady: no input is switched, so that what follows the inputs slowly enough needs no lag.
    """
    # Occam's razor: another pole has to leave much less, since a system with more poles never leaves more. A
    # driven mass counts against an oscillator, which contains it as the limit of no spring.
    first = left["first-order"]
    line, second, mass = (left.get(name, np.inf) for name in ("linear", "second-order", "driven-mass"))
    if mass < _MUCH_LESS * first and mass < _AS_GOOD * second:
        return "driven-mass"
    if steady and line < _WELL:
        return "linear"
    if first > _WELL and second < _MUCH_LESS * min(first, line):
        return "second-order"
    return "linear" if samples < _FAST and line < _AS_GOOD * first else "first-order"


def _mean(responses: list[Response | None]) -> float:
    return float(np.mean([1.0 if one is None else one.unexplained for one in responses]))


def _step(table: Table) -> float:
    assert table.times is not None  # noqa: S101 - asked only of logs
    steps = np.concatenate([np.diff(table.times[rows]) for rows in table.pieces])
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if steps.size else 1.0
