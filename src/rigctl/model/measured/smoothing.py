"""Measured inputs without most of their noise.

An input that is read with noise acts on the model with it: what follows it at once is then estimated too flat
(errors in variables), which looks like an offset or a bend that the bench does not have. An input that moves
slowly beside its sampling is therefore smoothed: a parabola through the m readings around each one,

    u_s(t_k) = parabola through (t_j, u_j), |j − k| ≤ m/2,   Var ≈ 9·σ²/(4·m),

m the largest window whose residuals are noise alone: their size is σ's, and no stretch of them lies on one
side. An input that moves as fast as it is read keeps every reading.

Source: Fan & Gijbels, Local Polynomial Modelling and Its Applications (1996); Fuller, Measurement Error
Models (1987).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: readings that are smoothed over
WINDOWS = (33, 17, 9, 5)
#: residuals may be so much larger than the noise, and so many of their own sigmas off in a row
_LARGER, _OFF = 1.05, 4.0


def window_of(times: Sequence[Floats], values: Sequence[Floats], sigma: float) -> int:
    """Over how many readings an input of several records can be smoothed; 1 where it cannot be."""
    if not sigma > 0.0:
        return 1
    for window in WINDOWS:
        if all(_is_noise(t, u, sigma, window) for t, u in zip(times, values, strict=True)):
            return window
    return 1


def smoothed(times: Floats, values: Floats, window: int) -> Floats:
    """(n) the local parabolas at the readings' own times; the first and the last one reach to the ends."""
    if window <= 1 or times.size <= window:
        return values
    t = np.lib.stride_tricks.sliding_window_view(times, window)
    u = np.lib.stride_tricks.sliding_window_view(values, window)
    middle, width = t.mean(axis=1), 0.5 * (t[:, -1] - t[:, 0])
    off = (t - middle[:, None]) / width[:, None]
    basis = np.stack([np.ones_like(off), off, off**2], axis=2)
    square = np.swapaxes(basis, 1, 2) @ basis
    found = np.linalg.solve(square, np.swapaxes(basis, 1, 2) @ u[:, :, None])[:, :, 0]
    near = np.clip(np.arange(times.size) - window // 2, 0, len(t) - 1)
    at = (times - middle[near]) / width[near]
    return np.asarray(found[near, 0] + found[near, 1] * at + found[near, 2] * at**2)


def _is_noise(times: Floats, values: Floats, sigma: float, window: int) -> bool:
    if times.size < 3 * window:
        return False
    left = (values - smoothed(times, values, window)) / sigma
    if float(np.sqrt(np.mean(left**2))) > _LARGER:
        return False
    stretch = max(3, window // 3)
    runs = left[: left.size // stretch * stretch].reshape(-1, stretch).sum(axis=1) / math.sqrt(stretch)
    return float(np.abs(runs).max()) < _OFF
