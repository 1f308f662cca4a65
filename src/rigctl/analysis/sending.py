"""A fit in the form in which it is sent to other processes."""

from __future__ import annotations

from dataclasses import replace

from rigctl.model.fit.fit import FitResult


def lean(fitted: FitResult) -> FitResult:
    """The fit without derived results, which the receiver recomputes if needed."""
    return replace(fitted, problem=replace(fitted.problem))
