"""Restricted maximum likelihood of coloured noise under trends: unbiased although every trend was fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.windows import WindowGroup

#: a slower process cannot be told from a trend inside a window
HIGHEST_CORRELATION = 0.98
#: −2·ln of the likelihood ratio above which white noise on top is believed (1 % at one degree of freedom)
_WHITE_PAYS = 6.63
_WHITE_GRID = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9)


@dataclass(frozen=True)
class NoiseFit:
    """Sigma (SI), correlation and white share that fit a set of windows best, and how much data stood behind.

    Parameters
    ----------
    degrees: of freedom left after the trends.
    """

    sigma: float
    correlation: float
    white: float
    degrees: int


def fit_noise(groups: Sequence[WindowGroup]) -> NoiseFit:
    """Fit an AR(1) process with white noise on top to windows by restricted maximum likelihood.

    With ``u = Kᵀe`` free of trend and ``A = KᵀR(ρ, w)K``, ``R_ij = (1 − w)·ρ^|t_i − t_j| + w·[i = j]``,
    over all windows with ν degrees of freedom together

        −2·ln L(ρ, w) = Σ ln|A| + ν·ln(Σ uᵀA⁻¹u / ν),   σ² = Σ uᵀA⁻¹u / ν.

    Detrending makes the plain autocorrelation too small; this likelihood knows that the trend was taken out.
    w = 0 unless w > 0 raises 2·ln L by more than 6.63.

    Source: Patterson & Thompson, Biometrika 58 (1971) 545; Harville, J. Am. Stat. Assoc. 72 (1977) 320.
    """
    scatters = [(group, group.rows.T @ group.rows) for group in groups if group.rows.size]
    degrees = sum(group.rows.size for group, _ in scatters)

    def cost(rho: float, white: float) -> float:
        total, quadratic = _sums(scatters, rho, white)
        return total + degrees * float(np.log(quadratic / degrees))

    rho, least = _best_correlation(lambda at: cost(at, 0.0))
    white = 0.0
    if rho > 0.02:
        rho, white = _with_white(cost, rho, least)
    _, quadratic = _sums(scatters, rho, white)
    return NoiseFit(float(np.sqrt(quadratic / degrees)), rho, white, degrees)


def whitened(group: WindowGroup, fit: NoiseFit) -> NDArray[np.float64]:
    """(windows, degrees) rows of unit variance and without correlation, if the fit holds."""
    from scipy.linalg.lapack import dtrtri

    factor = np.zeros((group.rows.shape[1],) * 2)
    factor[_upper(group.rows.shape[1])] = _packed_factor(group, fit.correlation, fit.white)
    inverse, _ = dtrtri(factor)
    return np.asarray(group.rows @ inverse / fit.sigma)


def _sums(
    scatters: Sequence[tuple[WindowGroup, NDArray[np.float64]]], rho: float, white: float
) -> tuple[float, float]:
    """Σ ln|A| and Σ uᵀA⁻¹u over all windows."""
    from scipy.linalg.lapack import dpptri

    determinant = quadratic = 0.0
    for group, scatter in scatters:
        size = group.rows.shape[1]
        factor = _packed_factor(group, rho, white)
        diagonal = np.cumsum(np.arange(1, size + 1)) - 1
        determinant += 2.0 * group.rows.shape[0] * float(np.sum(np.log(factor[diagonal])))
        inverse, _ = dpptri(size, factor)
        packed = scatter[_upper(size)]
        quadratic += 2.0 * float(inverse @ packed) - float(inverse[diagonal] @ packed[diagonal])
    return determinant, quadratic


def _upper(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row and column of each element of a packed upper triangle, column after column."""
    column, row = np.tril_indices(size)
    return row, column


def _packed_factor(group: WindowGroup, rho: float, white: float) -> NDArray[np.float64]:
    """Cholesky factor U of A = UᵀU, packed.

    Packed, because the routines for full matrices start threads even for 40 rows, which costs more than the
    work as soon as the cores are shared.
    """
    from scipy.linalg.lapack import dpptrf

    size = group.rows.shape[1]
    factor, _ = dpptrf(size, _reduced(group, rho, white)[_upper(size)])
    return np.asarray(factor)


def _reduced(group: WindowGroup, rho: float, white: float) -> NDArray[np.float64]:
    """A = KᵀRK."""
    apart = np.abs(group.places[:, None] - group.places[None, :])
    coloured = np.where(apart == 0.0, 1.0, rho**apart)
    matrix = (1.0 - white) * (group.complement.T @ coloured @ group.complement)
    return np.asarray(matrix + white * np.eye(matrix.shape[0]))


def _best_correlation(cost: Callable[[float], float]) -> tuple[float, float]:
    """The least cost over 0 ≤ ρ ≤ highest, looked for in atanh ρ, and 0 itself if nothing beats it."""
    from scipy.optimize import minimize_scalar

    top = float(np.arctanh(HIGHEST_CORRELATION))
    found = minimize_scalar(
        lambda at: cost(float(np.tanh(at))), bounds=(0.0, top), method="bounded", options={"xatol": 1e-3}
    )
    at_zero = cost(0.0)
    if at_zero <= float(found.fun):
        return 0.0, at_zero
    return float(np.tanh(found.x)), float(found.fun)


def _with_white(cost: Callable[[float, float], float], rho: float, least: float) -> tuple[float, float]:
    from scipy.optimize import minimize_scalar

    def profile(white: float) -> float:
        return _best_correlation(lambda at: cost(at, white))[1]

    start = min(_WHITE_GRID, key=profile)
    found = minimize_scalar(
        profile,
        bounds=(max(0.0, start - 0.15), min(0.99, start + 0.15)),
        method="bounded",
        options={"xatol": 0.01},
    )
    if float(found.fun) > least - _WHITE_PAYS:
        return rho, 0.0
    white = float(found.x)
    return _best_correlation(lambda at: cost(at, white))[0], white
