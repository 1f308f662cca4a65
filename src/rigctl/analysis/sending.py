"""A fit as it is sent to other processes."""

from __future__ import annotations

from dataclasses import replace

from rigctl.model.fit.fit import FitResult


def lean(fitted: FitResult) -> FitResult:
    """The fit without what was computed from it, which whoever gets it computes again where it is needed."""
    return replace(fitted, problem=replace(fitted.problem))
