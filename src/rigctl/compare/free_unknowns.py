"""Which of a model's common unknowns can take a misfit over."""

from __future__ import annotations

from rigctl.engine.least_squares import Unknown
from rigctl.model.fit.fit import FitResult


def free_unknowns(fit: FitResult) -> list[Unknown]:
    """The shared unknowns that the fit could still move: not those that it left at a bound.

    A model that was taken as it is moves nothing.
    """
    if fit.solution is None:
        return []
    return [unknown for unknown in fit.problem.shared if unknown.name not in fit.at_bound]
