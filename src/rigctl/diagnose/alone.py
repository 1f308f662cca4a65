"""One effect at a time on top of a model, fitted in the equations that hold the whole library already."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rigctl.compare.candidates import Candidate
from rigctl.compare.result import ModelComparison
from rigctl.engine.least_squares import Unknown
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.unknowns import effect_unknown

#: so far inside its bounds a parameter begins, as a share of their distance
_ROOM = 1e-6
#: a fit ends when the next step would lower its cost by less than this share: what is asked is coarse
_COST = 1e-3


#: in χ²: a proper fit brings a coarse one no nearer than that
_NEAR = 40.0


@dataclass(frozen=True)
class Alone:
    """A model with one effect, fitted; `chi2` is what that leaves."""

    candidate: Candidate
    fit: FitResult = field(repr=False)
    chi2: float


def alone(before: ModelComparison, candidate: Candidate, *, from_null: bool) -> Alone | None:
    """Fit a model with one effect more, begun at its null or at its typical size.

    Nothing is compiled for it. None when the model has no value there.
    """
    return _fitted(before, candidate, 0.0 if from_null else 1.0)


def near_best(found: Mapping[str, Alone | None]) -> list[str]:
    """The effects whose fits come near the best one's, the best first."""
    fitted = [one for one in found.values() if one is not None]
    fitted.sort(key=lambda one: one.chi2)
    return [one.candidate.name for one in fitted if one.chi2 < fitted[0].chi2 + _NEAR]


def _fitted(before: ModelComparison, candidate: Candidate, share: float) -> Alone | None:
    whole, known = before.whole, before.fit
    names = whole.compiled.system.parameter_names
    base = whole.base.copy()
    for name, value in candidate.shapes.items():
        base[names.index(name)] = value
    at = {u.name: float(value) for u, value in zip(known.problem.shared, known.values, strict=True)}
    shared = [replace(u, start=min(max(at[u.name], u.lower), u.upper)) for u in known.problem.shared]
    problem = whole.with_shared([*shared, *_switched_on(candidate, share)], base)
    try:
        found = fit(problem, known.held_out, local=known.local, cost=_COST)
    except RigctlError:
        return None
    assert found.solution is not None  # noqa: S101 - there is something to fit
    return Alone(candidate, found, 2.0 * found.solution.cost)


def _switched_on(candidate: Candidate, share: float) -> list[Unknown]:
    """The effect's parameters at a share of their typical size, inside their bounds."""
    found = []
    for column in candidate.columns:
        declared = candidate.effect.parameter(column.partition(".")[2])
        room = _ROOM * (declared.high - declared.low)
        begin = declared.at_null + share * (declared.start - declared.at_null)
        start = float(np.clip(begin, declared.low + room, declared.high - room))
        found.append(effect_unknown(candidate.effect, declared.name, start))
    return found
