"""One effect at a time on top of a model, fitted in the equations that hold the whole library already."""

from __future__ import annotations

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


@dataclass(frozen=True)
class Alone:
    """A model with one effect, fitted; `chi2` is what that leaves."""

    candidate: Candidate
    fit: FitResult = field(repr=False)
    chi2: float


def alone(before: ModelComparison, candidate: Candidate) -> Alone | None:
    """Fit a model with one effect more, begun at its null and at its typical size: the better of the two.

    Nothing is compiled for it. None when the model has no value there.
    """
    found = [one for share in (0.0, 1.0) if (one := _fitted(before, candidate, share)) is not None]
    return min(found, key=lambda one: one.chi2, default=None)


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
