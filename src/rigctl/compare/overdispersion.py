"""What a fitted model leaves beyond the noise, as a factor by which differences between models count less."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.errors import whitened_residual
from rigctl.model.fit.fit import FitResult

#: lags that are summed: up to this share of a record
_LAGS = 0.25


def variance_factor(fit: FitResult) -> float:
    """The long-run variance of the whitened residuals, no less than 1: 1 where a model leaves noise alone.

    ``φ = c_0 + 2·Σ_(k ≤ K) (1 − k/(K + 1))·c_k``, c_k the autocovariance at lag k of the residuals of each
    channel of each record, over all fitted ones; K is a quarter of the longest. What is left of a model that
    is not right in any case (another shape, a slow drift) has a larger variance than the noise, and is slow:
    its readings are not independent, and a difference of χ² between two such models counts as 1/φ of itself.

    Source: Newey & West, Econometrica 55 (1987) 703; Burnham & Anderson, *Model Selection and Multimodel
    Inference* (2002), §2.5.
    """
    series = _by_channel(fit)
    if not series:
        return 1.0
    most = int(_LAGS * max(one.size for one in series))
    sums = np.zeros(most + 1)
    for one in series:
        found = _autocovariance(one)[: most + 1]
        sums[: found.size] += found
    covariance = sums / sum(one.size for one in series)
    weights = 1.0 - np.arange(1, most + 1) / (most + 1.0)
    return max(1.0, float(covariance[0]), float(covariance[0] + 2.0 * weights @ covariance[1:]))


def _by_channel(fit: FitResult) -> list[NDArray[np.float64]]:
    """The whitened residuals of each channel of each fitted record, in time."""
    found = []
    for place in fit.fitted:
        white = whitened_residual(fit.problem, fit.outputs[place], place)
        channel = fit.problem.whiteners[place].rows[:, 1]
        found += [white[channel == one] for one in np.unique(channel)]
    return [one for one in found if one.size]


def _autocovariance(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of the products of values k apart, for k from 0."""
    padded = np.fft.rfft(values, 2 * values.size)
    return np.asarray(np.fft.irfft(np.abs(padded) ** 2, 2 * values.size)[: values.size])
