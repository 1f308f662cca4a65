"""Serial correlation of residuals: how long they stay alike, and whether they are white."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: largest lag in a correlation time, as a share of the longest piece
_LAGS = 0.5
#: lags of the portmanteau test
PORTMANTEAU_LAGS = 12
#: fewest independent values that residuals count as, however long they stay alike
_FEWEST = 4.0


def autocovariance(pieces: Sequence[Floats], lags: int) -> Floats:
    """(lags + 1) sums of products of values k apart, over evenly sampled pieces about their common mean."""
    mean = float(np.mean(np.concatenate(pieces)))
    sums = np.zeros(lags + 1)
    for piece in pieces:
        away = piece - mean
        spectrum = np.fft.rfft(away, 2 * away.size)
        covariances = np.fft.irfft(np.abs(spectrum) ** 2, 2 * away.size)[: min(away.size, lags + 1)]
        sums[: covariances.size] += covariances
    return sums


def correlation_time(pieces: Sequence[Floats]) -> float:
    """Integrated autocorrelation time, in samples: n values are worth n/τ independent ones; at least 1.

    ``τ = 1 + 2·Σ ρ_k``, summed in pairs (ρ_k + ρ_(k+1)) until one is no longer positive.

    Source: C. J. Geyer, Stat. Sci. 7 (1992) 473 (initial positive sequence).
    """
    count = sum(piece.size for piece in pieces)
    longest = max((piece.size for piece in pieces), default=0)
    if longest < 3:
        return 1.0
    sums = autocovariance(pieces, max(2, int(_LAGS * longest)))
    if not sums[0] > 0.0:
        return 1.0
    rho = sums / sums[0]
    together = 1.0
    for k in range(1, rho.size - 1, 2):
        pair = float(rho[k] + rho[k + 1])
        if pair <= 0.0:
            break
        together += 2.0 * pair
    return float(min(max(together, 1.0), max(1.0, count / _FEWEST)))


def portmanteau(pieces: Sequence[Floats]) -> float:
    """p-value of the hypothesis that values are white, from their first twelve autocorrelations.

    ``Q = n·(n + 2)·Σ ρ_k²/(n − k)`` is χ² with as many degrees of freedom as lags. 1 if there are too few.

    Source: G. M. Ljung, G. E. P. Box, Biometrika 65 (1978) 297.
    """
    from scipy.special import gammaincc

    count = sum(piece.size for piece in pieces)
    lags = min(PORTMANTEAU_LAGS, count // 4)
    if lags < 1:
        return 1.0
    sums = autocovariance(pieces, lags)
    if not sums[0] > 0.0:
        return 1.0
    rho = sums[1:] / sums[0]
    statistic = count * (count + 2.0) * float(np.sum(rho**2 / (count - np.arange(1, lags + 1))))
    return float(gammaincc(0.5 * lags, 0.5 * statistic))
