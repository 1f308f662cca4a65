"""The precision of the size of an effect: half-widths of 95 % intervals, in display units."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rigctl.analysis.decision_levels import INTERVAL
from rigctl.model.fit.fit import FitResult
from rigctl.model.model import Model
from rigctl.units import parse_unit


def unit_of(model: Model, column: str) -> str:
    """The unit in which a parameter of one of the model's effects is shown."""
    effect, _, name = column.partition(".")
    return model.effect(effect).parameter(name).unit


def half_width(model: Model, column: str, std: float) -> float:
    """The half-width for a standard deviation, SI, in the unit in which the parameter is shown."""
    return INTERVAL * std / parse_unit(unit_of(model, column)).factor


def known_to(fitted: FitResult, columns: Iterable[str]) -> dict[str, float]:
    """The half-widths with which a fit determines the parameters of its model's effects; those that it does
    not fit are left out."""
    model, factor = fitted.problem.model, _widened(fitted)
    free = {unknown.name for unknown in fitted.problem.shared}
    return {name: half_width(model, name, factor * fitted.std[name]) for name in columns if name in free}


def relative_width(fitted: FitResult, effects: Iterable[str]) -> float:
    """The largest half-width as a share of its parameter's value, over all fitted sizes of these effects.

    Shape parameters (a width, a velocity) are not sizes and do not count. 0 if nothing is fitted.
    """
    wanted, model, factor = set(effects), fitted.problem.model, INTERVAL * _widened(fitted)
    shares = [0.0]
    for unknown, value in zip(fitted.problem.shared, fitted.values, strict=True):
        effect, _, name = unknown.name.partition(".")
        if effect in wanted and name and not model.effect(effect).parameter(name).shape:
            away = abs(float(value) - model.effect(effect).parameter(name).at_null)
            shares.append(factor * fitted.std[unknown.name] / away if away > 0.0 else math.inf)
    return max(shares)


def _widened(fitted: FitResult) -> float:
    """The factor by which the misfit beyond the noise widens a fit's intervals."""
    return math.sqrt(max(1.0, fitted.chi2_reduced))
