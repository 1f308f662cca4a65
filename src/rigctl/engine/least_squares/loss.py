"""How much a residual counts: squares, or less than that for outliers.

The cost of a residual r is ``c²/2 · rho((r/c)²)``, c the threshold in standard deviations from which it
counts less. As in B. Triggs et al., Bundle adjustment - a modern synthesis (2000), section 4.3, and in
scipy.optimize.least_squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SMALLEST_CURVATURE = float(np.finfo(float).eps)


class Loss(Protocol):
    """The function rho of z = (r/c)² with its first two derivatives."""

    @property
    def threshold(self) -> float:
        """c, in standard deviations."""
        ...

    def rho(self, z: Floats) -> tuple[Floats, Floats, Floats]:
        """(rho, rho', rho'') at z."""
        ...


@dataclass(frozen=True)
class Squares:
    """rho = z: every residual counts by its square."""

    threshold: float = 1.0

    def rho(self, z: Floats) -> tuple[Floats, Floats, Floats]:
        """(z, 1, 0)."""
        return z, np.ones_like(z), np.zeros_like(z)


@dataclass(frozen=True)
class Huber:
    """rho = z up to 1, then 2·sqrt(z) - 1: squares up to the threshold, then linear."""

    threshold: float = 3.0

    def rho(self, z: Floats) -> tuple[Floats, Floats, Floats]:
        """(rho, rho', rho'') at z."""
        far = z > 1.0
        root = np.sqrt(np.where(far, z, 1.0))
        return (
            np.where(far, 2.0 * root - 1.0, z),
            np.where(far, 1.0 / root, 1.0),
            np.where(far, -0.5 / root**3, 0.0),
        )


@dataclass(frozen=True)
class SoftL1:
    """rho = 2·(sqrt(1 + z) - 1): smooth from squares to linear."""

    threshold: float = 3.0

    def rho(self, z: Floats) -> tuple[Floats, Floats, Floats]:
        """(rho, rho', rho'') at z."""
        root = np.sqrt(1.0 + z)
        return 2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3


@dataclass(frozen=True)
class Cauchy:
    """rho = ln(1 + z): far outliers hardly count."""

    threshold: float = 3.0

    def rho(self, z: Floats) -> tuple[Floats, Floats, Floats]:
        """(rho, rho', rho'') at z."""
        return np.log1p(z), 1.0 / (1.0 + z), -1.0 / (1.0 + z) ** 2


def cost_of(loss: Loss, residual: Floats) -> float:
    """``c²/2 · sum(rho((r/c)²))``."""
    if isinstance(loss, Squares):
        return 0.5 * float(residual @ residual)
    rho = loss.rho((residual / loss.threshold) ** 2)[0]
    return 0.5 * loss.threshold**2 * float(rho.sum())


def weights(loss: Loss, residual: Floats) -> tuple[Floats, Floats] | None:
    """Factors (for residuals, for derivatives) that make a Gauss-Newton step see the loss; None for squares.

    With both applied, Jᵀr is the gradient of the cost and JᵀJ its curvature, never below zero.
    """
    if isinstance(loss, Squares):
        return None
    z = (residual / loss.threshold) ** 2
    _, first, second = loss.rho(z)
    curvature = np.sqrt(np.maximum(first + 2.0 * second * z, _SMALLEST_CURVATURE))
    return first / curvature, curvature
