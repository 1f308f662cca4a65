"""Measured inputs with most of their noise removed.

The noise of a measured input acts on the model too: whatever follows the input at once is then estimated with
too small a slope (errors in variables), which looks like an offset or a curvature that the bench does not
have. An input that changes slowly compared with its sampling is therefore smoothed by local parabolas through
m readings,

    u_s(t_k) = parabola through (t_j, u_j), |j − k| ≤ m/2,   Var ≈ 9·σ²/(4·m),

m the largest window whose residuals are noise alone: they have standard deviation σ, and no run of them lies
on one side. An input that changes as fast as it is sampled is not smoothed.

Source: Fan & Gijbels, Local Polynomial Modelling and Its Applications (1996); Fuller, Measurement Error
Models (1987).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: window lengths, in readings
WINDOWS = (33, 17, 9, 5)
#: tolerated excess of the residuals over the noise, and of a run of them, in its own sigmas
_LARGER, _OFF = 1.05, 4.0


def window_of(times: Sequence[Floats], values: Sequence[Floats], sigma: float) -> int:
    """The number of readings over which an input of several records can be smoothed; 1 if not at all."""
    if not sigma > 0.0:
        return 1
    for window in WINDOWS:
        if all(_is_noise(t, u, sigma, window) for t, u in zip(times, values, strict=True)):
            return window
    return 1


def smoothed(times: Floats, values: Floats, window: int) -> Floats:
    """(n) the local parabolas at the times of the readings; the first and the last one extend to the ends."""
    if window <= 1 or times.size <= window:
        return values
    # a parabola for every window at once, in coordinates from −1 to 1, for which the normal equations are
    # well conditioned
    t = np.lib.stride_tricks.sliding_window_view(times, window)
    u = np.lib.stride_tricks.sliding_window_view(values, window)
    middle, width = t.mean(axis=1), 0.5 * (t[:, -1] - t[:, 0])
    off = (t - middle[:, None]) / width[:, None]
    basis = np.stack([np.ones_like(off), off, off**2], axis=2)
    square = np.swapaxes(basis, 1, 2) @ basis
    coefficients = np.linalg.solve(square, np.swapaxes(basis, 1, 2) @ u[:, :, None])[:, :, 0]
    near = np.clip(np.arange(times.size) - window // 2, 0, len(t) - 1)
    at = (times - middle[near]) / width[near]
    return np.asarray(coefficients[near, 0] + coefficients[near, 1] * at + coefficients[near, 2] * at**2)


def _is_noise(times: Floats, values: Floats, sigma: float, window: int) -> bool:
    if times.size < 3 * window:
        return False
    residuals = (values - smoothed(times, values, window)) / sigma
    if float(np.sqrt(np.mean(residuals**2))) > _LARGER:
        return False
    # sums over stretches: an input that the parabolas cut off is on one side of them for as long as a third
    # of a window, and noise is not
    stretch = max(3, window // 3)
    runs = residuals[: residuals.size // stretch * stretch].reshape(-1, stretch).sum(axis=1) / math.sqrt(
        stretch
    )
    return float(np.abs(runs).max()) < _OFF
