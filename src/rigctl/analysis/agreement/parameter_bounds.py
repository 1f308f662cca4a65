"""The bounds of an effect's parameters in a fit: usual ranges, and the order of two parameters.

Physical limits hold, but limits of the usual range never decide: a fit that stopped at one is repeated with
wider bounds. One that violated an order between two parameters (static friction is never less than Coulomb
friction) is repeated within that order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigctl.analysis.linear.candidates import Candidate
from rigctl.effects.declaration import qualified
from rigctl.engine.least_squares import Unknown
from rigctl.model.fit.fit import FitResult
from rigctl.units import show

#: closer to a bound than this share of the distance between the bounds, a fit counts as held there
_AT = 1e-9
#: least distance of two bounds, as a share of their magnitudes
_APART = 1e-9


def beyond_usual(fitted: FitResult, chosen: Sequence[Candidate]) -> list[Unknown] | None:
    """The shared unknowns of a fit, with those bounds that held it and are only usual limits moved outwards.

    None if there are no such bounds: the fit stays as it is.
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
    return starting_at_fit(fitted, wider) if wider else None


def in_order(fitted: FitResult, chosen: Sequence[Candidate]) -> list[Unknown] | None:
    """The shared unknowns of a fit, bounded so that no parameter is below the one declared as its lower
    limit.

    The common bound of the two is where the quadratic approximation at the minimum is least with both equal:
    ``m = 1ᵀH·x̂/(1ᵀH·1)``, H being the inverse of their covariance. None if the order holds already.
    """
    parted = {}
    for lower, column in ordered_pairs(chosen):
        low, high = _unknown(fitted, lower), _unknown(fitted, column)
        if low is not None and high is not None and value_of(fitted, column) < value_of(fitted, lower):
            middle = _meeting(fitted, lower, column)
            room = _APART * max(abs(middle), low.size)
            parted[lower] = replace(low, upper=max(middle, low.lower + room), start=middle)
            parted[column] = replace(high, lower=min(middle, high.upper - room), start=middle)
    return starting_at_fit(fitted, parted) if parted else None


def ordered(shared: Sequence[Unknown], chosen: Sequence[Candidate]) -> list[Unknown]:
    """The unknowns bounded by their starts, so that no parameter falls below the one that is its lower limit.

    For a fit that starts where the two are equal, at the limiting case of an effect.
    """
    bounded = {one.name: one for one in shared}
    for lower, column in ordered_pairs(chosen):
        if lower in bounded and column in bounded:
            low, high = bounded[lower], bounded[column]
            room = _APART * max(abs(high.start), high.size)
            bounded[lower] = replace(low, upper=max(min(low.start, low.upper), low.lower + room))
            bounded[column] = replace(high, lower=min(max(high.start, high.lower), high.upper - room))
    return list(bounded.values())


def ordered_pairs(chosen: Sequence[Candidate]) -> Iterator[tuple[str, str]]:
    """The pairs of parameters with an order: the one that is the lower limit, and the other."""
    for candidate in chosen:
        for column in candidate.columns:
            lower = candidate.parameter(column).at_least
            if lower is not None:
                yield qualified(candidate.name, lower), column


def value_of(fitted: FitResult, column: str) -> float:
    """A fitted parameter of an effect, SI; its fixed value if the fit left it out because it acts on
    nothing."""
    names = [unknown.name for unknown in fitted.problem.shared]
    if column in names:
        return float(fitted.values[names.index(column)])
    return float(fitted.problem.base[fitted.problem.compiled.system.parameter_names.index(column)])


def unusual_text(fitted: FitResult, candidate: Candidate) -> str:
    """Which of its parameters are outside their usual range; "" if none is.

    For example ``coefficient beyond its usual range (0 m to 20000 m)``.
    """
    parts = []
    for column in candidate.columns:
        declared = candidate.parameter(column)
        if declared.unusual(value_of(fitted, column)):
            low, high = (
                show(end, declared.unit, difference=declared.difference)
                for end in (declared.low, declared.high)
            )
            parts.append(f"{declared.name} beyond its usual range ({low} to {high})")
    return ", ".join(parts)


def _unknown(fitted: FitResult, column: str) -> Unknown | None:
    return {one.name: one for one in fitted.problem.shared}.get(column)


def starting_at_fit(fitted: FitResult, changed: Mapping[str, Unknown]) -> list[Unknown]:
    """The shared unknowns, each starting where the fit ended."""
    unknowns = []
    for unknown, value in zip(fitted.problem.shared, fitted.values, strict=True):
        one = changed.get(unknown.name, unknown)
        unknowns.append(replace(one, start=min(max(float(value), one.lower), one.upper)))
    return unknowns


def _meeting(fitted: FitResult, lower: str, upper: str) -> float:
    assert fitted.solution is not None  # noqa: S101 - an effect's parameters are free in a trial
    names = [unknown.name for unknown in fitted.problem.shared]
    indices = [names.index(lower), names.index(upper)]
    values = fitted.values[indices]
    covariance = fitted.solution.covariance[np.ix_(indices, indices)]
    if not np.isfinite(covariance).all() or not np.all(np.diag(covariance) > 0.0):
        return float(values.mean())
    weights = np.linalg.pinv(covariance, hermitian=True).sum(axis=0)
    total = float(weights.sum())
    middle = float(weights @ values) / total if total > 0.0 else math.nan
    return middle if values.min() <= middle <= values.max() else float(values.mean())
