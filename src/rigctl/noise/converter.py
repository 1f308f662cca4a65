"""Quantisation: the step of a converter, and its effect on the noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

#: least number of differences between neighbouring values from which a grid is determined
_FEWEST = 4
#: largest deviation of a difference from the grid, as a share of a step, because files are rounded
_OFF_GRID = 0.12
#: least share of the differences that must lie on the grid
_ON_GRID = 0.95
#: harmonics of the quantisation error in the sum
_HARMONICS = np.arange(1, 21)


def find_step(series: Sequence[NDArray[np.float64]]) -> float:
    """The converter's step for one channel; 0 if its values lie on no grid.

    The differences between occurring neighbouring values must be whole multiples of one step, except for a
    few (such as a logger's placeholder), and values must recur: at least a tenth of the samples repeat
    earlier ones.

    Parameters
    ----------
    series: the finite values of the channel, record by record; each record may have a different offset.
    """
    between, samples, distinct = [], 0, 0
    for values in series:
        if values.size == 0:
            continue
        unique = np.unique(values)
        gaps = np.diff(unique)
        real = gaps[gaps > 1e-8 * float(np.max(np.abs(unique)))]
        between.append(real)
        samples += values.size
        distinct += real.size + 1
    gaps = np.concatenate(between) if between else np.empty(0)
    if gaps.size < _FEWEST or distinct > 0.9 * samples:
        return 0.0
    for start in np.quantile(gaps, [0.0, 0.1, 0.25]).tolist():
        step = float(start)
        for _ in range(3):
            step = float(np.mean(gaps[np.abs(gaps - step) < 0.5 * step]))
        multiples = np.maximum(1.0, np.round(gaps / step))
        on_grid = np.abs(gaps - multiples * step) < _OFF_GRID * step * np.sqrt(multiples)
        if np.mean(on_grid) >= _ON_GRID:
            return float(gaps[on_grid].sum() / multiples[on_grid].sum())
    return 0.0


def stretch_bias(step: float, before: float) -> float:
    """Standard deviation (SI) of the quantisation error shared by all samples at one level.

    The mean of ``round(x)`` over normal noise of standard deviation σ₀ differs from the level x by
    ``Σ_k (−1)^k·Δ/(π·k)·exp(−2π²k²σ₀²/Δ²)·sin(2πk·x/Δ)``; over levels the standard deviation of that is

        ``√(Σ_k (Δ/(π·k))²·exp(−4π²k²σ₀²/Δ²)/2)``,

    the first term of which is ``Δ/π·exp(−2π²σ₀²/Δ²)/√2``. It is Δ/√12 without noise, and negligible from σ₀ ≈
    Δ on.

    Parameters
    ----------
    step: Δ, SI.
    before: σ₀, SI, standard deviation of the noise before conversion.

    Source: Widrow & Kollár, *Quantization Noise* (2008), ch. 5 and 11.
    """
    if step == 0.0:
        return 0.0
    shrink = np.exp(-4.0 * (np.pi * _HARMONICS * before / step) ** 2)
    return float(step / np.pi * np.sqrt(np.sum(shrink / _HARMONICS**2) / 2.0))


def noise_before(step: float, sigma: float) -> float:
    """σ₀ (SI) before conversion, from sigma after it, level by level: solves σ₀² + Δ²/12 − bias(σ₀)² = σ²."""
    if step == 0.0:
        return sigma
    low, high = 0.0, sigma + step
    for _ in range(60):
        middle = 0.5 * (low + high)
        after = middle**2 + step**2 / 12.0 - stretch_bias(step, middle) ** 2
        low, high = (middle, high) if after < sigma**2 else (low, middle)
    return 0.5 * (low + high)


def window_share(levels: NDArray[np.float64], step: float, before: float) -> NDArray[np.float64]:
    """Variance after quantisation inside windows, as a share of ``σ₀² + Δ²/12``, its average over all levels.

    Noise smaller than a step is reduced in the middle of a step and increased at its edge, and a signal that
    moves within a step carries the bias of every level into the window. In units of steps, the converter
    returns n at level x with the probability ``P_n(x) = Φ((n + ½ − x)/s) − Φ((n − ½ − x)/s)``; the share is
    the mean over the window of the variance of n, plus the variance over the window of ``E[n] − x``.

    Parameters
    ----------
    levels: (windows, samples) SI, relative to a value that the converter can return.
    step: Δ, SI.
    before: σ₀, SI.

    Returns
    -------
    (windows) 1 for a signal that crosses whole steps; less or more if it is at rest.
    """
    from scipy.special import ndtr

    width = max(before / step, 1e-3)
    off = np.linspace(-0.5, 0.5, 101)
    reach = int(np.ceil(6.0 * width)) + 1
    codes = np.arange(-reach, reach + 1)
    chance = ndtr((codes + 0.5 - off[:, None]) / width) - ndtr((codes - 0.5 - off[:, None]) / width)
    mean = chance @ codes
    variance = chance @ codes**2 - mean**2
    at = levels / step
    at = at - np.round(at)
    spread = np.interp(at, off, variance).mean(axis=1) + np.interp(at, off, mean - off).var(axis=1)
    return np.asarray(spread / (width**2 + 1.0 / 12.0))
