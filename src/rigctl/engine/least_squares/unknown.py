"""A quantity to be estimated, and its prior."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigctlError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Prior:
    """A normal distribution, for example of a datasheet's value with its uncertainty."""

    mean: float
    std: float


@dataclass(frozen=True)
class Unknown:
    """One parameter of a fit.

    Attributes
    ----------
    name: used in results and messages.
    start: starting value.
    lower, upper: bounds, infinite if there are none.
    scale: a typical size; the change in one iteration is limited to a part of it. By default the magnitude of
        `start`, or of the bounds if that is zero.
    prior: prior knowledge.
    unit: SI, for the result's table.
    linear: the residuals depend on it linearly, or nearly, wherever the others are: its steps are neither
        damped nor limited. It needs a prior.

    Raises
    ------
    RigctlError
        a number is not finite, the start lies outside the bounds, scale or prior are not positive, or an
        unknown that is linear has no prior.
    """

    name: str
    start: float
    lower: float = -math.inf
    upper: float = math.inf
    scale: float | None = None
    prior: Prior | None = None
    unit: str = "1"
    linear: bool = False

    def __post_init__(self) -> None:
        problem = ""
        if not math.isfinite(self.start):
            problem = "its start is not a finite number"
        elif not self.lower < self.upper:
            problem = "its lower bound is not below its upper bound"
        elif not self.lower <= self.start <= self.upper:
            problem = f"its start lies outside its bounds {self.lower:g} … {self.upper:g}"
        elif self.scale is not None and not 0.0 < self.scale < math.inf:
            problem = "its scale is not positive"
        elif self.prior is not None and not (self.prior.std > 0.0 and math.isfinite(self.prior.mean)):
            problem = "its prior has no finite mean or no positive standard deviation"
        elif self.linear and self.prior is None:
            problem = "it is linear, and has no prior"
        if problem:
            raise RigctlError(f"parameter {self.name}: {problem}", value=f"{self.start:g}")

    @property
    def size(self) -> float:
        """The typical size that limits a step."""
        if self.scale is not None:
            return self.scale
        bounds = [abs(bound) for bound in (self.lower, self.upper) if bound and math.isfinite(bound)]
        return abs(self.start) or (self.prior.std if self.prior else 0.0) or min(bounds, default=1.0)


def starts(unknowns: Sequence[Unknown]) -> Floats:
    """The starting value, inside the bounds."""
    return np.array([unknown.start for unknown in unknowns], dtype=float)


def started(unknowns: Sequence[Unknown], values: Floats) -> list[Unknown]:
    """The unknowns with `values`, clipped to their bounds, as starting values."""
    return [
        replace(unknown, start=min(max(float(value), unknown.lower), unknown.upper))
        for unknown, value in zip(unknowns, values, strict=True)
    ]


@dataclass(frozen=True)
class Priors:
    """The priors of several unknowns as rows of a least-squares problem.

    Attributes
    ----------
    mean: (unknowns) of each prior; 0 if there is none.
    weight: (unknowns) 1/std; 0 if there is none.
    """

    mean: Floats
    weight: Floats

    @classmethod
    def of(cls, unknowns: Sequence[Unknown]) -> Priors:
        """The priors of `unknowns`, in their order."""
        mean, weight = np.zeros(len(unknowns)), np.zeros(len(unknowns))
        for index, unknown in enumerate(unknowns):
            if unknown.prior is not None:
                mean[index], weight[index] = unknown.prior.mean, 1.0 / unknown.prior.std
        return cls(mean, weight)

    def residual(self, values: Floats) -> Floats:
        """``(value - mean)/std`` of each; zero if it has no prior."""
        return (values - self.mean) * self.weight


def prior_rows(unknowns: Sequence[Unknown], values: Floats) -> tuple[Floats, Floats]:
    """(residual (value - mean)/std, 1/std) of each unknown; zeros if it has no prior."""
    priors = Priors.of(unknowns)
    return priors.residual(values), priors.weight
