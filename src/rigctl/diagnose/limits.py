"""Bounds of an effect's parameters: what physics forbids holds, and what is only unusual never decides.

A fit stops at both kinds. Where it stopped at a bound that says what is usual it is made again beyond it;
where it broke an order of two parameters (no seal sticks with less than it drags) it is made again within.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigctl.compare.candidates import Candidate
from rigctl.effects.declaration import qualified
from rigctl.engine.least_squares import Unknown
from rigctl.model.fit.fit import FitResult
from rigctl.units import show

#: so near a bound, as a share of the distance of the two, a fit counts as held there
_AT = 1e-9
#: the least distance of two bounds, as a share of their sizes
_APART = 1e-9


def beyond_usual(fitted: FitResult, chosen: Sequence[Candidate]) -> list[Unknown] | None:
    """The shared unknowns of a fit with the bounds that held it moved outwards, where these are only usual.

    None where none is: the fit stands.
    """
    wider = {}
    for candidate in chosen:
        for column in candidate.columns:
            declared = candidate.parameter(column)
            low, high = declared.widest
            unknown = _unknown(fitted, column)
            if unknown is None or column not in fitted.at_bound:
                continue
            value, room = value_of(fitted, column), _AT * (declared.high - declared.low)
            if low < unknown.lower and value <= unknown.lower + room:
                wider[column] = replace(unknown, lower=low, scale=max(unknown.size, abs(value)))
            elif high > unknown.upper and value >= unknown.upper - room:
                wider[column] = replace(unknown, upper=high, scale=max(unknown.size, abs(value)))
    return _begun_there(fitted, wider) if wider else None


def in_order(fitted: FitResult, chosen: Sequence[Candidate]) -> list[Unknown] | None:
    """The shared unknowns of a fit, bounded so that no parameter is below the one it is never below.

    Both are parted where the quadratic through the minimum is least with the two equal:
    ``m = 1ᵀH·x̂/(1ᵀH·1)``, H the inverse of their covariance. None where the order holds already.
    """
    parted = {}
    for candidate in chosen:
        for column in candidate.columns:
            other = candidate.parameter(column).at_least
            lower = None if other is None else qualified(candidate.name, other)
            pair = (None, None) if lower is None else (_unknown(fitted, lower), _unknown(fitted, column))
            if lower is None or pair[0] is None or pair[1] is None:
                continue
            if value_of(fitted, column) < value_of(fitted, lower):
                middle = _meeting(fitted, lower, column)
                room = _APART * max(abs(middle), pair[0].size)
                parted[lower] = replace(pair[0], upper=max(middle, pair[0].lower + room), start=middle)
                parted[column] = replace(pair[1], lower=min(middle, pair[1].upper - room), start=middle)
    return _begun_there(fitted, parted) if parted else None


def value_of(fitted: FitResult, column: str) -> float:
    """A parameter of an effect as fitted, SI; its value where the fit left it out, as it acts on nothing."""
    names = [unknown.name for unknown in fitted.problem.shared]
    if column in names:
        return float(fitted.values[names.index(column)])
    return float(fitted.problem.base[fitted.problem.compiled.system.parameter_names.index(column)])


def unusual_text(fitted: FitResult, candidate: Candidate) -> str:
    """Which of its parameters lie beyond what is usual; "" where none does.

    As ``coefficient beyond its usual range (0 m to 20000 m)``.
    """
    found = []
    for column in candidate.columns:
        declared = candidate.parameter(column)
        if declared.unusual(value_of(fitted, column)):
            low, high = (
                show(end, declared.unit, difference=declared.difference)
                for end in (declared.low, declared.high)
            )
            found.append(f"{declared.name} beyond its usual range ({low} to {high})")
    return ", ".join(found)


def _unknown(fitted: FitResult, column: str) -> Unknown | None:
    return {one.name: one for one in fitted.problem.shared}.get(column)


def _begun_there(fitted: FitResult, changed: dict[str, Unknown]) -> list[Unknown]:
    """The shared unknowns, each beginning where the fit ended."""
    found = []
    for unknown, value in zip(fitted.problem.shared, fitted.values, strict=True):
        one = changed.get(unknown.name, unknown)
        found.append(replace(one, start=min(max(float(value), one.lower), one.upper)))
    return found


def _meeting(fitted: FitResult, lower: str, upper: str) -> float:
    assert fitted.solution is not None  # noqa: S101 - an effect's parameters are free in a trial
    names = [unknown.name for unknown in fitted.problem.shared]
    places = [names.index(lower), names.index(upper)]
    values = fitted.values[places]
    covariance = fitted.solution.covariance[np.ix_(places, places)]
    if not np.isfinite(covariance).all() or not np.all(np.diag(covariance) > 0.0):
        return float(values.mean())
    weights = np.linalg.pinv(covariance, hermitian=True).sum(axis=0)
    total = float(weights.sum())
    middle = float(weights @ values) / total if total > 0.0 else math.nan
    return middle if values.min() <= middle <= values.max() else float(values.mean())
