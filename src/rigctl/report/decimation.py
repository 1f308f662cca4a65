"""Decimation for display: points that a screen cannot resolve are left out, extremes are kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def thin(values: NDArray[np.float64], points: int) -> NDArray[np.intp]:
    """Indices of at most about `points` samples that draw the same line.

    The samples are cut into buckets of equal size; each keeps its lowest and its highest value, and its first
    missing one so that a gap stays a gap. The first and the last sample are kept. O(n).

    Parameters
    ----------
    values: shape (n,); NaN where a sample is missing.
    points: requested number, at least 4. With gaps up to half as many again are returned.

    Returns
    -------
    Increasing indices, shape (m,); all of them if n ≤ points.
    """
    count = len(values)
    if count <= points:
        return np.arange(count)
    buckets = max((points - 2) // 2, 1)
    size = -(-count // buckets)
    padded = np.full(buckets * size, np.nan)
    padded[:count] = values
    grid = padded.reshape(buckets, size)
    starts = np.arange(buckets) * size
    missing = np.isnan(grid)
    lowest = starts + np.where(missing, np.inf, grid).argmin(axis=1)
    highest = starts + np.where(missing, -np.inf, grid).argmax(axis=1)
    gaps = starts[missing.any(axis=1)] + missing[missing.any(axis=1)].argmax(axis=1)
    indices = np.unique(np.concatenate(([0, count - 1], lowest, highest, gaps)))
    return indices[indices < count]


def changes(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices that draw a step line exactly: the first sample, each one that differs from the one before,
    and the last.
    """
    count = len(values)
    if count == 0:
        return np.arange(0)
    before, after = values[:-1], values[1:]
    differ = (before != after) & ~(np.isnan(before) & np.isnan(after))
    return np.unique(np.concatenate(([0], np.flatnonzero(differ) + 1, [count - 1])))
