"""Scatter from run to run: unintended differences between records of one condition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: weight of the prior, in equivalent differences between replicates
PRIOR_DEGREES = 2.0
#: the prior is abandoned if such large differences are less probable than this under it
_SURPRISE = 0.05
#: without replicates the prior is widened by this factor
CAUTION = 1.5


@dataclass(frozen=True)
class Scatter:
    """Standard deviation between records of one condition, of each quantity.

    Parameters
    ----------
    sigma: (quantities) in the quantities' units; never zero unless the prior is.
    degrees: (quantities) effective degrees of freedom of sigma, the prior's included.
    replicates: number of records that repeat another one's condition.
    statement: one sentence on the source of sigma.
    """

    sigma: NDArray[np.float64]
    degrees: NDArray[np.float64]
    replicates: int
    statement: str


def estimate_scatter(
    values: NDArray[np.float64],
    std: NDArray[np.float64],
    conditions: NDArray[np.intp],
    *,
    prior: NDArray[np.float64],
) -> Scatter:
    """Scatter of record-level quantities between replicates, shrunk towards a prior.

    For replicates ``v_gi = μ_g + s_gi + e_gi``, s ~ N(0, τ²) the scatter and e ~ N(0, std²) the known
    uncertainty of each value. τ̂² solves ``Σ (v_gi − μ̂_g)²/(τ² + std_gi²) = ν``, ν = records − conditions,
    with μ̂_g the weighted mean (zero if the left side is smaller than ν at τ = 0). It counts as

        ``d = ν·(m/(m + mean std²))²``

    degrees of freedom, because a scatter small compared with std is poorly determined; m is prior², and τ̂²
    if the differences are too large for the prior (χ² test at 5 %). Then

        ``sigma² = (d·τ̂² + 2·prior²)/(d + 2)``.

    Without replicates sigma is the prior, widened by `CAUTION`.

    Parameters
    ----------
    values: (records, quantities); NaN where a record has none.
    std: (records, quantities) standard deviation of each value.
    conditions: (records) records that share a number are replicates.
    prior: (quantities) expected scatter, from the rig file.

    Raises
    ------
    ValueError
        inconsistent shapes.

    Source: Paule & Mandel, J. Res. Natl. Bur. Stand. 87 (1982) 377.
    """
    records, quantities = values.shape
    if std.shape != values.shape or conditions.shape != (records,) or prior.shape != (quantities,):
        raise ValueError(
            f"shapes do not match: {values.shape}, {std.shape}, {conditions.shape}, {prior.shape}"
        )
    from scipy.special import chdtri

    sigma, degrees = CAUTION * prior.astype(float), np.zeros(quantities)
    most = 0
    for i in range(quantities):
        known = np.isfinite(values[:, i]) & np.isfinite(std[:, i])
        _, group = np.unique(conditions[known], return_inverse=True)
        free = group.size - int(group.max(initial=-1)) - 1
        if free == 0:
            continue
        most = max(most, free)
        variance = std[known, i] ** 2
        between = _between(values[known, i], variance, group, free)
        shared = np.bincount(group)[group] > 1
        expected = float(prior[i]) ** 2
        surprising = _quadratic(values[known, i], variance + expected, group) > chdtri(free, _SURPRISE)
        size = max(between, expected) if surprising else expected
        noise = float(variance[shared].mean())
        counts = free * (size / (size + noise)) ** 2 if size > 0.0 else float(free)
        sigma[i] = np.sqrt((counts * between + PRIOR_DEGREES * prior[i] ** 2) / (counts + PRIOR_DEGREES))
        degrees[i] = counts + PRIOR_DEGREES
    return Scatter(sigma, degrees, most, _statement(most))


def _between(
    values: NDArray[np.float64], variance: NDArray[np.float64], group: NDArray[np.intp], free: int
) -> float:
    """τ̂² by Paule and Mandel's equation, whose left side decreases monotonically in τ²."""

    spread = float(np.sum((values - (np.bincount(group, values) / np.bincount(group))[group]) ** 2))
    if spread == 0.0:
        return 0.0
    low, high = 0.0, spread
    if not np.any(variance == 0.0) and _quadratic(values, variance, group) <= free:
        return 0.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _quadratic(values, middle + variance, group) > free else (low, middle)
    return 0.5 * (low + high)


def _quadratic(values: NDArray[np.float64], variance: NDArray[np.float64], group: NDArray[np.intp]) -> float:
    """Sum of squares about the weighted means of the groups, each over its variance."""
    if np.any(variance == 0.0):
        return float("inf")
    mean = np.bincount(group, values / variance) / np.bincount(group, 1.0 / variance)
    return float(np.sum((values - mean[group]) ** 2 / variance))


def _statement(replicates: int) -> str:
    if replicates == 0:
        return (
            "no condition was measured twice: the scatter from run to run is only assumed, "
            f"{CAUTION:g} times what the rig file expects"
        )
    times = "once" if replicates == 1 else f"{replicates} times"
    return f"scatter from run to run learned from conditions repeated {times}, with the rig file's as a prior"
