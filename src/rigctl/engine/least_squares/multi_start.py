"""Fits from several starting points, for costs with more than one minimum."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.block import Evaluate
from rigctl.engine.least_squares.result import Iteration, LeastSquaresResult
from rigctl.engine.least_squares.solve import least_squares
from rigctl.engine.least_squares.state import Options
from rigctl.engine.least_squares.unknown import Unknown
from rigctl.errors import RigctlError

_SAME = 1e-6
#: ratio of two positive bounds beyond which a parameter is a scale
_DECADES = 100.0


@dataclass(frozen=True)
class MultiStartResult:
    """The best of several fits, and the results of all of them.

    Attributes
    ----------
    best: the fit with the lowest cost.
    costs: of each start, in the order in which they were tried; infinite if the model could not be simulated
        there.
    agreeing: number of starts that reached the best cost, within a relative 1e-6.
    """

    best: LeastSquaresResult
    costs: tuple[float, ...]
    agreeing: int

    def summary(self) -> str:
        """The best fit, and how many starts agree with it."""
        return f"{self.agreeing} of {len(self.costs)} starts reached the best cost. {self.best.summary()}"


def multi_start(
    evaluate: Evaluate,
    unknowns: Sequence[Unknown],
    local: Sequence[Sequence[Unknown]],
    *,
    count: int = 8,
    seed: int = 0,
    options: Options | None = None,
    progress: Callable[[Iteration], None] | None = None,
) -> MultiStartResult:
    """Fit from the given start and from `count` - 1 others, spread as a Latin hypercube.

    A shared parameter with two finite bounds starts anywhere between them, on a logarithmic scale if they are
    positive and far apart; any other within its typical size of its given start. The record-level parameters
    keep their starts.

    Raises
    ------
    RigctlError
        as `least_squares`, if no start can be fitted.
    """
    results: list[LeastSquaresResult] = []
    costs: list[float] = []
    refused: RigctlError | None = None
    for start in _spread(unknowns, count, seed):
        moved = [replace(unknown, start=value) for unknown, value in zip(unknowns, start, strict=True)]
        try:
            result = least_squares(evaluate, moved, local, options=options, progress=progress)
        except RigctlError as problem:
            refused = refused or problem
            costs.append(math.inf)
        else:
            results.append(result)
            costs.append(result.cost)
    if not results:
        raise refused or RigctlError("a fit needs at least one start", value=str(count))
    best = min(results, key=lambda result: result.cost)
    near = best.cost + _SAME * abs(best.cost)
    return MultiStartResult(best, tuple(costs), sum(cost <= near for cost in costs))


def _spread(unknowns: Sequence[Unknown], count: int, seed: int) -> list[list[float]]:
    """The starts: the given one first, then one in each layer of every parameter's range."""
    # a Latin hypercube: each layer of each parameter's range is used once, however few starts there are
    random = np.random.default_rng(seed)
    first = [unknown.start for unknown in unknowns]
    layers = max(0, count - 1)
    shares: NDArray[np.float64] = np.empty((layers, len(unknowns)))
    for column in range(len(unknowns)):
        shares[:, column] = (random.permutation(layers) + random.uniform(size=layers)) / max(1, layers)
    low, high = np.array([_range(unknown) for unknown in unknowns]).reshape(-1, 2).T
    spread = low + shares * (high - low)
    scales = (low > 0.0) & (high > _DECADES * low)
    spread[:, scales] = low[scales] * (high[scales] / low[scales]) ** shares[:, scales]
    return [first, *spread.tolist()][: max(count, 0)]


def _range(unknown: Unknown) -> tuple[float, float]:
    if math.isfinite(unknown.lower) and math.isfinite(unknown.upper):
        return unknown.lower, unknown.upper
    low = max(unknown.lower, unknown.start - unknown.size)
    return low, min(unknown.upper, unknown.start + unknown.size)
