"""The result of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.identifiability import Combination
from rigctl.engine.least_squares.unknown import Unknown
from rigctl.errors import unknown_name
from rigctl.units import with_uncertainty

Floats = NDArray[np.float64]


class Outcome(StrEnum):
    """Reason for which a fit ended."""

    GRADIENT = "gradient"  #: the residuals are orthogonal to every column: an exact minimum
    COST = "cost"  #: the next step would lower the cost by a negligible share
    STEP = "step"  #: the next step would move no parameter noticeably
    STALLED = "stalled"  #: no step lowers the cost, though one should: the model is not smooth here
    ITERATIONS = "iterations"  #: the allowed number of iterations was used up


_CONVERGED = (Outcome.GRADIENT, Outcome.COST, Outcome.STEP)


@dataclass(frozen=True)
class Iteration:
    """The progress of a fit."""

    number: int
    cost: float
    step: float  #: the largest change of a parameter, in units of its size
    accepted: bool
    reason: str = ""  #: why the model refused the step, "" if it did not


@dataclass(frozen=True)
class LeastSquaresResult:
    """The parameters at the minimum, their uncertainty, and what the data do not determine.

    Attributes
    ----------
    unknowns: the shared parameters as given.
    values: (p) the fitted shared parameters.
    local: the fitted record-level parameters, an array for each record.
    cost: half the sum of squares, including the priors.
    residual_count, parameter_count: observations, and parameters of all kinds that were free at the end.
    covariance: (p, p) of the shared parameters, the record-level ones being free; zero for one held at a
        bound, infinite on the diagonal for one that the data do not determine.
    local_std: standard deviations of the record-level parameters.
    at_bound: names of the shared parameters held at a bound.
    singular_values: (p) of the scaled columns, as shares of the largest.
    weak: combinations of shared parameters that the data do not determine.
    outcome, message: how the fit ended.
    iterations, evaluations: work done.
    """

    unknowns: tuple[Unknown, ...]
    values: Floats
    local: tuple[Floats, ...]
    cost: float
    residual_count: int
    parameter_count: int
    covariance: Floats
    local_std: tuple[Floats, ...]
    at_bound: tuple[str, ...]
    singular_values: Floats
    weak: tuple[Combination, ...]
    outcome: Outcome
    message: str
    iterations: int
    evaluations: int

    @property
    def converged(self) -> bool:
        """True if a minimum was reached."""
        return self.outcome in _CONVERGED

    @property
    def std(self) -> Floats:
        """(p) standard deviations, for residuals in units of theirs."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Floats:
        """(p, p); zero for a parameter that is held or not determined."""
        std = self.std
        usable = (std > 0.0) & np.isfinite(std)
        inverse = np.where(usable, 1.0 / np.where(usable, std, 1.0), 0.0)
        correlation = np.where(np.isfinite(self.covariance), self.covariance, 0.0)
        correlation = correlation * inverse * inverse[:, None]
        np.fill_diagonal(correlation, 1.0)
        return correlation

    @property
    def variance_factor(self) -> float:
        """Twice the cost per degree of freedom: 1 if the model and the noise are right."""
        return 2.0 * self.cost / max(1, self.residual_count - self.parameter_count)

    def value(self, name: str) -> float:
        """A shared parameter found.

        Raises
        ------
        RigctlError
            there is none of that name.
        """
        names = [unknown.name for unknown in self.unknowns]
        if name not in names:
            raise unknown_name("fitted parameter", name, names)
        return float(self.values[names.index(name)])

    def summary(self) -> str:
        """A table of the shared parameters, and the problems with them."""
        lines = [
            f"{self.message} after {self.iterations} iterations; cost {self.cost:.6g}, "
            f"{self.residual_count} residuals, variance factor {self.variance_factor:.3g}"
        ]
        for unknown, value, std in zip(self.unknowns, self.values, self.std, strict=True):
            note = "  held at its bound" if unknown.name in self.at_bound else ""
            lines.append(
                f"  {unknown.name} = {with_uncertainty(float(value), float(std), unknown.unit)}{note}"
            )
        lines += [f"not determined by these data: {combination}" for combination in self.weak]
        return "\n".join(lines)
