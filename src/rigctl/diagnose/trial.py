"""A model with some candidates added: refitted, and judged by its misfit against its number of parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.candidates import Candidate
from rigctl.engine.least_squares import Unknown
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.unknowns import effect_unknown

Floats = NDArray[np.float64]

#: a trial is fitted until the next step would lower its cost by less than this share
_COST = 1e-6


@dataclass(frozen=True)
class Trial:
    """A set of effects on top of the model, refitted together with the model's own parameters.

    Attributes
    ----------
    candidates: the effects with their shapes; none for the model as it is.
    fit: of the library's superset, the effects' parameters among its shared unknowns.
    chi2: whitened squares with the priors' share.
    parameters: of the effects, those at a bound not counted.
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

    def value(self, column: str) -> tuple[float, float]:
        """A parameter of an effect, and its standard deviation, SI."""
        names = [unknown.name for unknown in self.fit.problem.shared]
        return float(self.fit.values[names.index(column)]), self.fit.std.get(column, math.nan)


def plain(fitted: FitResult, whole: Problem) -> Trial:
    """The model itself as a trial of the superset `whole`, without fitting it again."""
    solution = fitted.solution
    chi2 = 2.0 * solution.cost if solution is not None else _chi2(fitted)
    return Trial((), replace(fitted, problem=_at(fitted, whole)), chi2, 0)


def refit(
    fitted: FitResult, whole: Problem, chosen: Sequence[Candidate], starts: dict[str, float]
) -> Trial | None:
    """Fit the model's parameters and those of `chosen`, from `starts`; None when that cannot be done.

    Parameters
    ----------
    fitted: the model's own fit, from which everything begins.
    whole: the same data with the whole library at its null.
    starts: of the effects' parameters, SI; what is left out starts at its typical size.
    """
    base = whole.base.copy()
    names = whole.compiled.system.parameter_names
    for candidate in chosen:
        for name, value in candidate.shapes.items():
            base[names.index(name)] = value
    unknowns = list(_started(fitted))
    for candidate in chosen:
        for column in candidate.columns:
            own = column.partition(".")[2]
            unknowns.append(_inside(effect_unknown(candidate.effect, own, starts.get(column))))
    problem = whole.with_shared(unknowns, base)
    try:
        found = fit(problem, fitted.held_out, local=fitted.local, cost=_COST)
    except RigctlError:  # the model has no value there: this effect is no explanation
        return None
    assert found.solution is not None  # noqa: S101 - there is something to fit
    held = set(found.solution.at_bound)
    free = sum(column not in held for candidate in chosen for column in candidate.columns)
    return Trial(tuple(chosen), found, 2.0 * found.solution.cost, free)


def _started(fitted: FitResult) -> list[Unknown]:
    """The model's unknowns, beginning where its fit ended."""
    return [
        replace(unknown, start=float(np.clip(value, unknown.lower, unknown.upper)))
        for unknown, value in zip(fitted.problem.shared, fitted.values, strict=True)
    ]


def _inside(unknown: Unknown) -> Unknown:
    """Not at a bound, from which a fit would have to find its way in first."""
    room = 1e-6 * (unknown.upper - unknown.lower)
    return replace(unknown, start=min(max(unknown.start, unknown.lower + room), unknown.upper - room))


def _at(fitted: FitResult, whole: Problem) -> Problem:
    return whole.with_shared(_started(fitted))


def _chi2(fitted: FitResult) -> float:
    return fitted.chi2_reduced * sum(fitted.problem.whiteners[k].size for k in fitted.fitted)
