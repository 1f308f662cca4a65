"""The chance that a verdict names the right one, and that an effect is seen at all.

The gain of 2·ln L by new records is about normal. Were the first of two rivals right at parameters θ, and Δ
and δ what θ predicts less what the second and the first one predict at their fits,

    D = Δᵀ·S₂⁻¹·Δ − δᵀ·S₁⁻¹·δ          V = |S₂⁻¹·Δ − S₁⁻¹·δ|²          gain ~ N(D, 4·V)

as both are refitted. Where the data so far leave no doubt of θ, V = D.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.levels import (
    ALPHA,
    LEAST_DIFFERENCE,
    LEAST_SEPARATION,
    QUANTILE,
    REFIT_SCATTER,
    TOLERANCE,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Gain:
    """The gain of 2·ln L at draws of what is right.

    Attributes
    ----------
    mean: (draws) D.
    variance: (draws) V, a quarter of the gain's variance.
    """

    mean: Floats
    variance: Floats

    def scaled(self, factor: float) -> Gain:
        """For noise whose variance is `factor` times as large."""
        return Gain(self.mean / factor, self.variance / factor)


def gain(from_right: Floats, left_right: Floats, from_rival: Floats, left_rival: Floats) -> Gain:
    """The gain at each draw.

    Parameters
    ----------
    from_right, from_rival: δ and Δ, (rows, draws): what the draws predict less what the two do at their fits.
    left_right, left_rival: ``S₁⁻¹·δ`` and ``S₂⁻¹·Δ``.
    """
    mean = np.einsum("nk,nk->k", from_rival, left_rival) - np.einsum("nk,nk->k", from_right, left_right)
    return Gain(mean, np.einsum("nk->k", np.square(left_rival - left_right)))


def told_apart(gained: Gain, margin: float, so_far: float, threshold: float = LEAST_DIFFERENCE) -> float:
    """The chance that a verdict tells two rivals apart: ``P = Φ((L₀ + D − t)/(2·√V))``, the mean over draws.

    A verdict asks for odds, t, and for a separation d of the two, which is expected to be ``√(D₀ + D)/2``;
    where that is too small, for what the refits' own separation needs.

    Parameters
    ----------
    margin: L₀, mBIC of the rival less that of the right one, so far.
    so_far: D₀, of the data so far.
    threshold: t.
    """
    from scipy.special import ndtr

    expected = 0.5 * np.sqrt(np.maximum(so_far + gained.mean, 0.0))
    by_refit = (2.0 * LEAST_SEPARATION + REFIT_SCATTER * 2.0) ** 2
    asked = np.where(expected >= LEAST_SEPARATION, threshold, max(threshold, by_refit))
    ahead = margin + gained.mean - asked
    spread = 2.0 * np.sqrt(np.maximum(gained.variance, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        deviates = np.where(spread > 0.0, ahead / spread, np.where(ahead >= 0.0, math.inf, -math.inf))
    return float(np.mean(ndtr(deviates)))


def enough(margin: float, so_far: float, threshold: float) -> float:
    """D* that tells two rivals apart in 99 cases of 100: ``√D* = z + √(z² + t − L₀)``, and as much as the
    separation asks for; arguments as of `told_apart`."""
    lacking = max(threshold - margin, 0.0)
    by_odds = (QUANTILE + math.sqrt(QUANTILE**2 + lacking)) ** 2
    return max(by_odds, (2.0 * LEAST_SEPARATION) ** 2 - so_far)


def threshold_of(explained: float) -> float:
    """t: the margin that a verdict asks for where an effect explains so much, in χ²: a difference within the
    tolerance of its law tells nothing."""
    return max(LEAST_DIFFERENCE, TOLERANCE**2 * explained)


def enough_seen(parameters: int, library: int) -> float:
    """λ² at which an effect is seen in 99 cases of 100, nearly: ``(√χ²_α + z)²``."""
    from scipy.stats import chi2

    return float((math.sqrt(chi2.isf(ALPHA / max(library, 1), parameters)) + QUANTILE) ** 2)


def seen(noncentrality: float | Floats, parameters: int, library: int) -> float:
    """The chance that an effect stands out of a library: the power of χ² at the family-wise level.

    Parameters
    ----------
    noncentrality: λ², of one or of several draws.
    parameters: of the effect.
    library: K, how many effects are looked through.
    """
    from scipy.stats import chi2, ncx2

    asked = chi2.isf(ALPHA / max(library, 1), parameters)
    values = np.maximum(np.atleast_1d(np.asarray(noncentrality, dtype=float)), 1e-12)
    return float(np.mean(ncx2.sf(asked, parameters, values)))
