"""Means of a course over the intervals of a grid, by quadrature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigctl.engine.excitation import Floats

#: nodes of a mean, as shares of an interval, and their weights: Gauss's of three points
GAUSS: Final = ((0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5), (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0))


@dataclass(frozen=True)
class Nodes:
    """Times at which a drive is evaluated, and what each counts in the mean over its interval.

    Attributes
    ----------
    times, weights: (nodes).
    first: (intervals) the first node of each.
    """

    times: Floats
    weights: Floats
    first: np.ndarray

    @classmethod
    def of(cls, grid: Floats, edges: Floats, at: Sequence[float], weights: Sequence[float]) -> Nodes:
        """Of the intervals of `grid`, with nodes `at` shares of each interval of its refinement `edges`."""
        lengths = np.diff(edges)
        times = edges[:-1, None] + lengths[:, None] * np.array(at)
        interval = np.searchsorted(grid, edges[:-1], side="right") - 1
        share = (lengths / np.diff(grid)[interval])[:, None] * np.array(weights)
        return cls(times.ravel(), share.ravel(), len(at) * np.searchsorted(edges, grid[:-1]))

    def means(self, values: Floats) -> Floats:
        """(intervals, ...) of (nodes, ...)."""
        weights = self.weights.reshape(-1, *(1,) * (values.ndim - 1))
        return np.asarray(np.add.reduceat(weights * values, self.first, axis=0))
