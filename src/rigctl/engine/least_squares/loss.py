"""Loss functions: squares, and robust losses that limit the influence of outliers.

The cost of a residual r is ``c²/2 · rho((r/c)²)``; c, in standard deviations, is the threshold beyond which a
residual is down-weighted.

Source: B. Triggs et al., Bundle adjustment - a modern synthesis (2000), section 4.3, as in
scipy.optimize.least_squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Loss(Protocol):
    """The function rho of z = (r/c)², and its slope."""

    @property
    def threshold(self) -> float:
        """c, in standard deviations."""
        ...

    def rho(self, z: Floats) -> Floats:
        """ρ(z), with z = (r/c)²."""
        ...

    def slope(self, z: Floats) -> Floats:
        """rho'."""
        ...


@dataclass(frozen=True)
class Squares:
    """rho = z: every residual counts by its square."""

    threshold: float = 1.0

    def rho(self, z: Floats) -> Floats:
        """ρ(z), with z = (r/c)²."""
        return z

    def slope(self, z: Floats) -> Floats:
        """rho'."""
        return np.ones_like(z)


@dataclass(frozen=True)
class Huber:
    """rho = z up to 1, then 2·sqrt(z) - 1: squares up to the threshold, then linear."""

    threshold: float = 3.0

    def rho(self, z: Floats) -> Floats:
        """ρ(z), with z = (r/c)²."""
        return np.where(z > 1.0, 2.0 * np.sqrt(z) - 1.0, z)

    def slope(self, z: Floats) -> Floats:
        """rho'."""
        return 1.0 / np.sqrt(np.maximum(z, 1.0))


@dataclass(frozen=True)
class SoftL1:
    """rho = 2·(sqrt(1 + z) - 1): smooth from squares to linear."""

    threshold: float = 3.0

    def rho(self, z: Floats) -> Floats:
        """ρ(z), with z = (r/c)²."""
        return 2.0 * (np.sqrt(1.0 + z) - 1.0)

    def slope(self, z: Floats) -> Floats:
        """rho'."""
        return 1.0 / np.sqrt(1.0 + z)


@dataclass(frozen=True)
class Cauchy:
    """rho = ln(1 + z): far outliers hardly count."""

    threshold: float = 3.0

    def rho(self, z: Floats) -> Floats:
        """ρ(z), with z = (r/c)²."""
        return np.log1p(z)

    def slope(self, z: Floats) -> Floats:
        """rho'."""
        return 1.0 / (1.0 + z)


def cost_of(loss: Loss, residual: Floats) -> float:
    """``c²/2 · sum(rho((r/c)²))``."""
    if isinstance(loss, Squares):
        return 0.5 * float(residual @ residual)
    return 0.5 * loss.threshold**2 * float(loss.rho((residual / loss.threshold) ** 2).sum())


def weights(loss: Loss, residual: Floats) -> Floats | None:
    """Factors sqrt(rho') for residuals and derivatives, with which a Gauss-Newton step minimises the loss.

    With them Jᵀr is the gradient of the cost. The curvature omits rho'': it is then never negative, and never
    smaller than that of the cost, so that a step does not overshoot. None for squares.
    """
    if isinstance(loss, Squares):
        return None
    return np.sqrt(loss.slope((residual / loss.threshold) ** 2))
