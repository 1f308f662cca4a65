"""One effect at a time on top of a model, fitted in the equations that hold the whole library already."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigctl.compare.candidates import Candidate
from rigctl.compare.result import ModelComparison
from rigctl.effects.declaration import EffectParameter
from rigctl.engine.least_squares import Unknown
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.unknowns import effect_unknown

#: so far inside its bounds a parameter begins, as a share of their distance
_ROOM = 1e-6
#: a fit ends when the next step would lower its cost by less than this share: what is asked is coarse, and
#: coarser still with the effect held at a size
_COST, _COST_HELD = 1e-3, 5e-3
#: in χ²: a proper fit brings a coarse one no nearer than that
_NEAR = 40.0
#: sizes beyond the typical one, up to the bound, at which an effect is looked at, in each of its directions
_SIZES = 3
#: a fit that leaves less than this share of a misfit has found what the effect can do
_EXPLAINED = 0.5
#: a fit is begun again at a size at which less than this share is left of what it left
_BETTER = 0.9


@dataclass(frozen=True)
class Alone:
    """A model with one effect, fitted; `chi2` is what that leaves.

    `at_sizes` are the fits of the model's own parameters with the effect held at one size after the other,
    where these were made (see the function).
    """

    candidate: Candidate
    fit: FitResult = field(repr=False)
    chi2: float
    at_sizes: tuple[FitResult, ...] = field(default=(), repr=False)


def alone(before: ModelComparison, candidate: Candidate, *, from_null: bool) -> Alone | None:
    """Fit a model with one effect more, begun at its null or at its typical size.

    What an effect does may be no straight line in its size, and a fit stays in the minimum that it begins in:
    one that explains little is begun again where the effect explains more, held at sizes up to its bound.
    Nothing is compiled for it. None when the model has no value there.
    """
    share = 0.0 if from_null else 1.0
    begin = {
        column: declared.at_null + share * (declared.start - declared.at_null)
        for column, declared in _declared(candidate).items()
    }
    found = _fitted(before, candidate, begin, before.fit)
    if found is not None and _chi2(found) < _EXPLAINED * _chi2(before.fit):
        return Alone(candidate, found, _chi2(found))
    held = _held_at_sizes(before, candidate)
    if held:
        sizes, nearest = min(held, key=lambda one: _chi2(one[1]))
        if found is None or _chi2(nearest) < _BETTER * _chi2(found):
            found = _fitted(before, candidate, sizes, nearest)
    return None if found is None else Alone(candidate, found, _chi2(found), tuple(one for _, one in held))


def at_sizes(before: ModelComparison, found: Alone) -> tuple[FitResult, ...]:
    """The model's own parameters fitted with an effect held at sizes from beyond its typical one up to the
    largest that is usual."""
    return found.at_sizes or tuple(one for _, one in _held_at_sizes(before, found.candidate))


def near_best(found: Mapping[str, Alone | None]) -> list[str]:
    """The effects whose fits come near the best one's, the best first."""
    fitted = [one for one in found.values() if one is not None]
    fitted.sort(key=lambda one: one.chi2)
    return [one.candidate.name for one in fitted if one.chi2 < fitted[0].chi2 + _NEAR]


def _declared(candidate: Candidate) -> dict[str, EffectParameter]:
    return {name: candidate.parameter(name) for name in candidate.columns}


def _sizes(candidate: Candidate) -> list[dict[str, float]]:
    """Sizes of an effect's parameters, together, in equal ratios from the typical ones to the bounds."""
    found = []
    for side in (1.0, -1.0):
        for k in range(1, _SIZES + 1):
            sizes = {}
            for column, declared in _declared(candidate).items():
                typical = side * (declared.start - declared.at_null)
                limit = (declared.high if typical > 0.0 else declared.low) - declared.at_null
                if typical and limit / typical > 0.0:
                    sizes[column] = declared.at_null + typical * (limit / typical) ** (k / _SIZES)
            if len(sizes) == len(candidate.columns):
                found.append(sizes)
    return found


def _held_at_sizes(before: ModelComparison, candidate: Candidate) -> list[tuple[dict[str, float], FitResult]]:
    """Sizes of an effect, and the model's own parameters fitted with it; not where the model has no value."""
    found = []
    for sizes in _sizes(candidate):
        held = {name: _inside(candidate, name, size) for name, size in sizes.items()}
        one = _fit(before, candidate, held, (), before.fit)
        if one is not None:
            found.append((sizes, one))
    return found


def _fitted(
    before: ModelComparison, candidate: Candidate, sizes: Mapping[str, float], begin: FitResult
) -> FitResult | None:
    """The model's own parameters and an effect's, which begin at `sizes`, inside their bounds."""
    free = [
        effect_unknown(candidate.effect, name.partition(".")[2], _inside(candidate, name, size))
        for name, size in sizes.items()
    ]
    return _fit(before, candidate, {}, free, begin)


def _inside(candidate: Candidate, column: str, size: float) -> float:
    declared = _declared(candidate)[column]
    room = _ROOM * (declared.high - declared.low)
    return float(np.clip(size, declared.low + room, declared.high - room))


def _fit(
    before: ModelComparison,
    candidate: Candidate,
    held: Mapping[str, float],
    free: Sequence[Unknown],
    begin: FitResult,
) -> FitResult | None:
    whole = before.whole
    names = whole.compiled.system.parameter_names
    base = whole.base.copy()
    for name, value in {**candidate.shapes, **held}.items():
        base[names.index(name)] = value
    at = {u.name: float(value) for u, value in zip(begin.problem.shared, begin.values, strict=True)}
    own = before.fit.problem.shared
    shared = [replace(u, start=min(max(at[u.name], u.lower), u.upper)) for u in own]
    problem = whole.with_shared([*shared, *free], base)
    try:
        cost = _COST_HELD if held else _COST
        return fit(problem, before.fit.held_out, local=begin.local, cost=cost)
    except RigctlError:
        return None


def _chi2(found: FitResult) -> float:
    assert found.solution is not None  # noqa: S101 - a diagnosis asks for parameters to fit
    return 2.0 * found.solution.cost
