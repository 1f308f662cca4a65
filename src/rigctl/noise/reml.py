"""Restricted maximum likelihood of coloured noise under trends: unbiased although every trend was fitted.

In: windows with the polynomials that represent the signal in them. Out: σ, correlation and white share
(`NoiseFit`). Plain estimates from detrended windows have too small a variance and too small a correlation,
because the trend has absorbed the slowest part of the noise; this likelihood is that of what the trend
cannot contain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.autoregression import has_correlation, innovations
from rigctl.noise.minimum import least_between
from rigctl.noise.windows import WindowGroup

#: a slower process cannot be distinguished from a trend inside a window
HIGHEST_CORRELATION = 0.98
#: least −2·ln of the likelihood ratio for added white noise (1 % at one degree of freedom)
_WHITE_PAYS = 6.63
_WHITE_GRID = (0.12, 0.3, 0.5, 0.7, 0.88, 0.96)
#: share of the sum of squares that may be rounding
_ROUNDING = 1e-14


@dataclass(frozen=True)
class NoiseFit:
    """Sigma (SI), correlation and white share that best fit a set of windows, and their degrees of freedom.

    Parameters
    ----------
    degrees: of freedom left after the trends.
    """

    sigma: float
    correlation: float
    white: float
    degrees: int


def fit_noise(groups: Sequence[WindowGroup], *, white: float | None = None) -> NoiseFit:
    """Fit an AR(1) process with white noise on top to windows by restricted maximum likelihood.

    With e the samples of a window, X its trend and ``R_ij = (1 − w)·ρ^|t_i − t_j| + w·[i = j]``, over all
    windows with ν degrees of freedom together

        −2·ln L(ρ, w) = Σ (ln|R| + ln|XᵀR⁻¹X|) + ν·ln(Q/ν),   σ² = Q/ν,
        Q = Σ (eᵀR⁻¹e − eᵀR⁻¹X·(XᵀR⁻¹X)⁻¹·XᵀR⁻¹e).

    Detrending makes the plain autocorrelation too small; this likelihood accounts for the trend. w is `white`
    if given; otherwise w = 0 unless w > 0 raises 2·ln L by more than 6.63. Constant windows give sigma 0.

    Source: Patterson & Thompson, Biometrika 58 (1971) 545; Harville, J. Am. Stat. Assoc. 72 (1977) 320.
    """
    groups = [group for group in groups if group.rows.size]
    if not groups:
        return NoiseFit(0.0, 0.0, 0.0, 0)
    degrees = sum(group.total_degrees for group in groups)
    sums = _Likelihood(groups)

    rounding = _ROUNDING * sums(0.0, 0.0)[1]
    if rounding <= 0.0:
        return NoiseFit(0.0, 0.0, 0.0, degrees)

    def cost(rho: float, white: float) -> float:
        determinant, quadratic = sums(rho, white)
        # readings that nearly follow their trend leave only rounding errors, which may be zero at some ρ
        quadratic = max(quadratic, rounding)
        return determinant + degrees * float(np.log(quadratic / degrees))

    share = white or 0.0
    # ρ first, with the white share as given; a white share, for which ρ is searched again, only if it pays.
    rho, least = _best_correlation(lambda at: cost(at, share), within=1e-3 if white is None else 0.01)
    if white is None and rho > 0.02:
        rho, share = _with_white(cost, rho, least)
    _, quadratic = sums(rho, share)
    return NoiseFit(float(np.sqrt(max(quadratic, rounding) / degrees)), rho, share, degrees)


def whitened(group: WindowGroup, fit: NoiseFit) -> NDArray[np.float64]:
    """(windows, samples) innovations less their trend; Σz² of a window is χ²(degrees) if the fit holds."""
    change = innovations(group.positions, fit.correlation, fit.white)
    trend = np.linalg.qr(change(group.trend))[0]
    z = change(group.rows.T) / fit.sigma
    return np.asarray((z - trend @ (trend.T @ z)).T)


class _Likelihood:
    """The sums of the likelihood over groups of windows, as functions of the correlation and the white share.

    Parameters
    ----------
    groups: of at least one window each.
    """

    def __init__(self, groups: Sequence[WindowGroup]) -> None:
        from rigctl.engine.compile import kernel, words_of
        from rigctl.engine.guards import width

        parts = [np.hstack([group.trend, _compressed(group.rows)]) for group in groups]
        sizes = np.array(
            [
                (*part.shape, group.trend.shape[1], group.rows.shape[0])
                for part, group in zip(parts, groups, strict=True)
            ],
            dtype=np.int64,
        )
        steps = np.concatenate([np.diff(group.positions, prepend=group.positions[:1]) for group in groups])
        work = max(int(columns * (orders + 3)) for _, columns, orders, _ in sizes.tolist())
        self._at, self._found = np.empty(2), np.empty(2)
        self._arrays = (  # a reference to each is held here, since a kernel has only their addresses
            sizes,
            steps.astype(np.float64),
            np.concatenate([part.ravel() for part in parts]),
            self._at,
            self._found,
            np.empty(work),
        )
        self._words = words_of(*self._arrays)
        self._kernel = kernel("likelihood", width() > 0)

    def __call__(self, rho: float, white: float) -> tuple[float, float]:
        """Σ (ln|R| + ln|XᵀR⁻¹X|) and Q over all windows."""
        self._at[:] = (rho, white) if has_correlation(rho, white) else (0.0, 0.0)
        self._kernel(self._words)
        determinant, quadratic = self._found.tolist()
        return determinant, quadratic


def _compressed(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """(samples, samples at most) columns with the same sum of squares and products as the windows."""
    if rows.shape[0] <= rows.shape[1]:
        return rows.T
    return np.asarray(np.linalg.qr(rows, mode="r")).T


def _best_correlation(cost: Callable[[float], float], *, within: float = 1e-3) -> tuple[float, float]:
    """The least cost over 0 ≤ ρ ≤ highest, searched in atanh ρ, and 0 itself if nothing is lower."""
    top = float(np.arctanh(HIGHEST_CORRELATION))
    optimum = least_between(lambda at: cost(float(np.tanh(at))), 0.0, top, within)
    at_zero = cost(0.0)
    if at_zero <= optimum.value:
        return 0.0, at_zero
    return float(np.tanh(optimum.at)), optimum.value


def _with_white(cost: Callable[[float, float], float], rho: float, least: float) -> tuple[float, float]:
    """Correlation and white share if white noise is significant; else the correlation alone."""

    def profile(white: float) -> float:
        return _best_correlation(lambda at: cost(at, white), within=0.03)[1]

    grid = [(profile(white), white) for white in _WHITE_GRID]
    best, start = min(grid)
    if best > least - 0.3 * _WHITE_PAYS:  # points between those of the grid cannot make up for the rest
        return rho, 0.0
    optimum = least_between(profile, max(0.0, start - 0.2), min(0.99, start + 0.2), 0.01)
    if min(best, optimum.value) > least - _WHITE_PAYS:
        return rho, 0.0
    white = optimum.at if optimum.value < best else start
    return _best_correlation(lambda at: cost(at, white))[0], white
