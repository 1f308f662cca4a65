"""A model with some candidates added: refitted, and judged by its misfit against its number of parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.candidates import Candidate
from rigctl.diagnose.limits import beyond_usual, in_order, unusual_text, value_of
from rigctl.engine.least_squares import Unknown
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]

#: a trial of noisy data is fitted until the next step would lower its cost by less than this share
_COST = 1e-5
#: a parameter may double in one step: an effect begins at its null, far below its size
_STEP = 1.0
#: so far inside its bounds an effect's parameter begins, as a share of their distance
_ROOM = 1e-6


@dataclass(frozen=True)
class Trial:
    """A set of effects on top of the model, refitted together with the model's own parameters.

    Attributes
    ----------
    candidates: the effects with their shapes; none for the model as it is.
    fit: of the model with the effects, their parameters among its shared unknowns.
    chi2: whitened squares with the priors' share.
    parameters: of the effects: one that ends at its bound was free to end elsewhere, and is paid for.
    """

    candidates: tuple[Candidate, ...]
    fit: FitResult = field(repr=False)
    chi2: float
    parameters: int

    @property
    def effects(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(candidate.name for candidate in self.candidates)

    def mbic(self, samples: float, library: int) -> float:
        """``χ² + parameters·ln N_eff + 2·effects·ln K``: Schwarz's criterion, modified for a search.

        The last term pays for having chosen among K effects.

        Source: M. Bogdan, J. K. Ghosh, R. W. Doerge, Genetics 167 (2004) 989.
        """
        count = len(self.candidates)
        return self.chi2 + self.parameters * math.log(samples) + 2.0 * count * math.log(max(library, 2))

    @property
    def unusual(self) -> dict[str, str]:
        """By effect, in words, its parameters beyond their usual range; empty where there are none."""
        said = {one.name: unusual_text(self.fit, one) for one in self.candidates}
        return {name: text for name, text in said.items() if text}

    def value(self, column: str) -> tuple[float, float]:
        """A parameter of an effect, and its standard deviation, SI; none where it acts on no reading."""
        return value_of(self.fit, column), self.fit.std.get(column, math.nan)

    def sizes(self, candidate: Candidate) -> Floats:
        """(columns) the parameters of one of its effects less their null, SI."""
        return np.array(
            [self.value(name)[0] - candidate.parameter(name).at_null for name in candidate.columns]
        )


def plain(fitted: FitResult) -> Trial:
    """The model itself, as it was fitted."""
    solution = fitted.solution
    return Trial((), fitted, 2.0 * solution.cost if solution is not None else _chi2(fitted), 0)


def refit(
    fitted: FitResult,
    chosen: Sequence[Candidate],
    begin: FitResult | None = None,
    *,
    cost: float = _COST,
    usual: bool = False,
) -> Trial | None:
    """Fit the model's parameters and those of `chosen`; None when that cannot be done.

    Effects that `begin` does not have begin at their null, where the misfit is what it was: begun at the
    size that the linear problem gives, an effect that the fitted parameters nearly imitate would start far
    off, and the fit would end in the valley between them. A fit that ends at a bound which only says what is
    usual goes on beyond it; one that breaks an order of an effect's parameters is made again within it.

    Parameters
    ----------
    fitted: of the model with none of the effects.
    begin: where the unknowns begin: the fit of another set; `fitted` when left out.
    cost: fitted until the next step would lower the cost by less than this share.
    usual: keep to the bounds that say what is usual.
    """
    try:
        model = fitted.model
        for candidate in chosen:
            model = model.with_effect(candidate.effect, _values(candidate))
        problem = fitted.problem.rebuilt(model)
        known = fitted if begin is None else begin
        problem = problem.with_shared(_started(problem, known))
        found = fit(problem, fitted.held_out, local=known.local, cost=cost, largest_step=_STEP)
        found, more = _refined(found, chosen, cost)
    except RigctlError:  # the model has no value there, or contradicts itself: this is no explanation
        return None
    if not usual:
        found = _again(found, beyond_usual(found, chosen), cost)
    found = _again(found, in_order(found, chosen), cost, forced=True)
    assert found.solution is not None  # noqa: S101 - there is something to fit
    columns = more + sum(len(candidate.columns) for candidate in chosen)
    return Trial(tuple(chosen), found, 2.0 * found.solution.cost, columns)


def _refined(found: FitResult, chosen: Sequence[Candidate], cost: float) -> tuple[FitResult, int]:
    """The fit with those of the effects' shapes free that may be refined, and how many; where that pays.

    Only once the effect is in: at its null a shape does nothing.
    """
    names = {
        (one.name, parameter.name)
        for one in chosen
        for parameter in one.effect.parameters
        if parameter.refined and parameter.shape
    }
    if not names:
        return found, 0
    model = found.model
    free = {
        effect: {
            name: replace(value, fit=value.fit or (effect, name) in names) for name, value in values.items()
        }
        for effect, values in model.effects.items()
    }
    problem = found.problem.rebuilt(replace(model, effects=free))
    problem = problem.with_shared(_started(problem, found))
    try:
        better = fit(problem, found.held_out, local=found.local, cost=cost, largest_step=_STEP)
    except RigctlError:
        return found, 0
    samples = sum(int(problem.ok[k].sum()) for k in found.fitted)
    pays = _cost(found) - _cost(better) > len(names) * math.log(max(samples, 2))
    return (better, len(names)) if pays else (found, 0)


def _cost(found: FitResult) -> float:
    assert found.solution is not None  # noqa: S101 - there is something to fit
    return 2.0 * found.solution.cost


def _again(found: FitResult, shared: list[Unknown] | None, cost: float, *, forced: bool = False) -> FitResult:
    """The fit made again with other bounds, or the one that was found where that is no better.

    With `forced` the other bounds hold, however good the fit is.
    """
    if shared is None:
        return found
    try:
        problem = found.problem.with_shared(shared)
        again = fit(problem, found.held_out, local=found.local, cost=cost, largest_step=_STEP)
    except RigctlError:  # the model has no value there
        return found
    assert again.solution is not None and found.solution is not None  # noqa: S101 - both have parameters
    return again if forced or again.solution.cost < found.solution.cost else found


def _values(candidate: Candidate) -> dict[str, float]:
    """The effect's parameters to begin with: at their null, or the size at which they were seen, but never at
    a bound, from which a fit must find in first."""
    values = {}
    for column in candidate.columns:
        declared = candidate.parameter(column)
        room = _ROOM * (declared.high - declared.low)
        values[declared.name] = min(max(declared.at_null, declared.low + room), declared.high - room)
    chosen = {**candidate.sizes, **candidate.shapes}
    return values | {name.partition(".")[2]: value for name, value in chosen.items()}


def _started(problem: Problem, fitted: FitResult) -> list[Unknown]:
    """The unknowns of a longer model, those of the shorter one beginning where its fit ended."""
    known = {u.name: float(v) for u, v in zip(fitted.problem.shared, fitted.values, strict=True)}
    return [replace(u, start=min(max(known.get(u.name, u.start), u.lower), u.upper)) for u in problem.shared]


def _chi2(fitted: FitResult) -> float:
    return fitted.chi2_reduced * sum(fitted.problem.whiteners[k].size for k in fitted.fitted)
