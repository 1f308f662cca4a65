"""The probability that a verdict names the right one of two rivals, and that an effect is detected at all.

The deviance (twice the log-likelihood ratio) of new records is approximately normal. If the first of two
rivals is right with parameters θ, and Δ and δ are the prediction at θ less that of the second and of the
first one at their fits,

    D = Δᵀ·S₂⁻¹·Δ − δᵀ·S₁⁻¹·δ          V = |S₂⁻¹·Δ − S₁⁻¹·δ|²          gain ~ N(D, 4·V)

as both are refitted. If the data so far determine θ exactly, V = D.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import (
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
    """The deviance (gain of 2·ln L) at draws of the truth.

    Attributes
    ----------
    mean: (draws) D.
    variance: (draws) V, a quarter of the gain's variance.
    """

    mean: Floats
    variance: Floats

    def scaled(self, factor: float) -> Gain:
        """The gain for noise with a variance `factor` times as large."""
        return Gain(self.mean / factor, self.variance / factor)


def gain(from_right: Floats, left_right: Floats, from_rival: Floats, left_rival: Floats) -> Gain:
    """The deviance at each draw.

    Parameters
    ----------
    from_right, from_rival: δ and Δ, (rows, draws): predictions at the draws less those of the two at their
        fits.
    left_right, left_rival: ``S₁⁻¹·δ`` and ``S₂⁻¹·Δ``.
    """
    mean = np.einsum("nk,nk->k", from_rival, left_rival) - np.einsum("nk,nk->k", from_right, left_right)
    return Gain(mean, np.einsum("nk->k", np.square(left_rival - left_right)))


def power_to_distinguish(
    gained: Gain, margin: float, so_far: float, threshold: float = LEAST_DIFFERENCE
) -> float:
    """The probability that a verdict distinguishes two rivals: ``P = Φ((L₀ + D − t)/(2·√V))``, mean over
    draws.

    A verdict requires odds, t, and a separation d of the two, whose expectation is ``√(D₀ + D)/2``; if that
    is too small, the separation from refits must suffice.

    Parameters
    ----------
    margin: L₀, mBIC of the rival less that of the right one, so far.
    so_far: D₀, of the data so far.
    threshold: t.
    """
    from scipy.special import ndtr

    # A verdict needs odds of t, and a separation: from signatures, if √(D₀ + D)/2 is expected to suffice,
    # otherwise from refits, less two of their standard deviations. P is that of a gain N(D, 4V) above what is
    # lacking to both.
    expected = 0.5 * np.sqrt(np.maximum(so_far + gained.mean, 0.0))
    by_refit = (2.0 * LEAST_SEPARATION + REFIT_SCATTER * 2.0) ** 2
    required = np.where(expected >= LEAST_SEPARATION, threshold, max(threshold, by_refit))
    ahead = margin + gained.mean - required
    spread = 2.0 * np.sqrt(np.maximum(gained.variance, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        deviates = np.where(spread > 0.0, ahead / spread, np.where(ahead >= 0.0, math.inf, -math.inf))
    return float(np.mean(ndtr(deviates)))


def enough(margin: float, so_far: float, threshold: float) -> float:
    """D* that distinguishes two rivals with probability 0.99: ``√D* = z + √(z² + t − L₀)``, and at least what
    the separation requires; arguments as in `power_to_distinguish`."""
    lacking = max(threshold - margin, 0.0)
    by_odds = (QUANTILE + math.sqrt(QUANTILE**2 + lacking)) ** 2
    return max(by_odds, (2.0 * LEAST_SEPARATION) ** 2 - so_far)


def threshold_of(explained: float) -> float:
    """t: the margin that a verdict requires if an effect explains so much, in χ²: a difference within the
    shape tolerance of its law is no evidence."""
    return max(LEAST_DIFFERENCE, TOLERANCE**2 * explained)


def enough_seen(parameters: int, library: int) -> float:
    """λ² at which an effect is detected with probability of about 0.99: ``(√χ²_α + z)²``."""
    from scipy.stats import chi2

    return float((math.sqrt(chi2.isf(ALPHA / max(library, 1), parameters)) + QUANTILE) ** 2)


def detection_power(noncentrality: float | Floats, parameters: int, library: int) -> float:
    """The probability that an effect is detected in a library: the power of χ² at the family-wise level.

    Parameters
    ----------
    noncentrality: λ², for one or several draws.
    parameters: number of parameters of the effect.
    library: K, the number of effects searched.
    """
    from scipy.stats import chi2, ncx2

    # χ² of the effect's parameters under H₀ at α/K (Bonferroni), non-central with λ² if the effect is there.
    critical = chi2.isf(ALPHA / max(library, 1), parameters)
    values = np.maximum(np.atleast_1d(np.asarray(noncentrality, dtype=float)), 1e-12)
    return float(np.mean(ncx2.sf(critical, parameters, values)))
