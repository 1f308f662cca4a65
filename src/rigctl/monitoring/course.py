"""The series of one quantity over the runs: its scatter from run to run, and the shape of a change.

    x_i = level(t_i) + b_i + e_i,   Var e_i = s_i²,   Var b_i = τ²

s_i is the standard error from run i itself, τ the additional scatter of the bench from run to run, unknown to
any run. τ is estimated from the median of the differences of neighbours, which is robust to a change and to
outliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: half of a normal distribution lies within this many standard deviations
_HALF: Final = 0.674490
#: least number of runs from which their scatter is estimated
FEWEST: Final = 6
#: a value is clipped at this distance from its neighbours' median, in standard deviations
_OFF: Final = 2.5
_NEIGHBOURS: Final = 3
#: largest number of change points at which a shape is fitted
_CUTS: Final = 200
#: increase of χ² that bounds the 95 % interval of the time of a change
_ALIKE: Final = 3.84


@dataclass(frozen=True)
class Shape:
    """A change of level: a step between two runs, or a ramp from one run on.

    Attributes
    ----------
    kind: ``step`` or ``growth`` (a ramp).
    begins: number of runs before it; `earliest` and `latest` the 95 % interval of that number.
    before, after: the level of the first and of the last run, with their standard deviations.
    cost: χ² of the residuals, outliers clipped.
    """

    kind: Literal["step", "growth"]
    begins: int
    earliest: int
    latest: int
    before: float
    before_std: float
    after: float
    after_std: float
    cost: float = 0.0


def scatter_between(values: Floats, std: Floats) -> float | None:
    """τ: the scatter from run to run beyond the runs' standard errors; None if there are too few runs.

    Solves ``median |d_i| / √(τ² + v_i) = 0.674`` for the differences d of neighbours over √2, v_i the mean of
    their s².
    """
    if values.size < FEWEST:
        return None
    size = np.abs(np.diff(values)) / math.sqrt(2.0)
    variance = 0.5 * (np.square(std[1:]) + np.square(std[:-1]))

    def share(square: float) -> float:
        return float(np.median(size / np.sqrt(square + variance + 1e-300)))

    # The runs' own standard errors explain all differences of neighbours: no scatter of the bench is needed.
    if share(0.0) <= _HALF:
        return 0.0
    low, high = 0.0, float(np.max(size)) / _HALF
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if share(middle**2) > _HALF else (low, middle)
    return high


def total_scatter(values: Floats, std: Floats) -> Floats:
    """(runs) total standard deviation of each value: τ combined with the run's own.

    If neighbours differ by less than the runs' standard errors, these are reduced by the common factor.
    """
    between = scatter_between(values, std)
    if between is None or between > 0.0:
        total = np.sqrt((between or 0.0) ** 2 + np.square(std))
    else:
        expected = np.sqrt(0.5 * (np.square(std[1:]) + np.square(std[:-1])) + 1e-300)
        total = std * float(np.median(np.abs(np.diff(values)) / expected)) / (math.sqrt(2.0) * _HALF)
    if np.all(total > 0.0):
        return np.asarray(total)
    return np.full(values.size, float(np.std(values)) or 1.0)


def standardised(values: Floats, std: Floats) -> Floats:
    """The values about their median, divided by their total scatter, so that imprecise runs count less."""
    return np.asarray((values - float(np.median(values))) / total_scatter(values, std))


def shape_of(values: Floats, std: Floats, over: Floats, correlation: float, *, steps: bool = False) -> Shape:
    """The step or ramp nearest to the series, by least squares with outliers clipped.

    Parameters
    ----------
    over: (runs) increasing; a ramp is linear in it.
    correlation: of neighbours, which increases the standard deviations of the levels.
    steps: fit only a step.
    """
    total = total_scatter(values, std)
    clipped_values = clipped(values, total)
    weights = 1.0 / np.square(total)
    # if the residuals exceed the runs' scatter, they determine the standard deviations of the levels
    best: tuple[float, str, int] | None = None
    costs: dict[tuple[str, int], float] = {}
    for kind in ("step",) if steps else ("step", "growth"):
        for cut in _cuts(values.size, kind):
            _, cost, _ = _fitted(kind, cut, clipped_values, weights, over)
            costs[kind, cut] = cost
            if best is None or cost < best[0]:
                best = cost, kind, cut
    if best is None:
        raise ValueError("too few runs for a change of level")
    cost, kind, cut = best
    # Correlated runs determine a level less well, by (1 + ρ)/(1 − ρ) in the variance; and the scatter about
    # the fitted shape counts if it is larger than assumed.
    inflated = (1.0 + correlation) / (1.0 - correlation) * max(1.0, cost / max(1, values.size - 3))
    alike = [at for (name, at), other in costs.items() if name == kind and other - cost <= _ALIKE * inflated]
    coefficients, _, covariance = _fitted(kind, cut, clipped_values, weights, over)
    first, last = _columns(kind, cut, over)[[0, -1]]
    error = [math.sqrt(max(0.0, float(row @ covariance @ row)) * inflated) for row in (first, last)]
    return Shape(
        kind="step" if kind == "step" else "growth",
        begins=cut,
        earliest=min(alike),
        latest=max(alike),
        before=float(first @ coefficients),
        before_std=error[0],
        after=float(last @ coefficients),
        after_std=error[1],
        cost=cost,
    )


def chi2_about(levels: Floats, values: Floats, std: Floats) -> float:
    """χ² of a series about given levels, outliers clipped."""
    total = total_scatter(values, std)
    return float(np.sum(np.square((clipped(values, total) - levels) / total)))


def clipped(values: Floats, sigma: Floats) -> Floats:
    """The values, outliers clipped to `_OFF` standard deviations from their neighbours' median."""
    result = values.copy()
    for k in range(values.size):
        low = max(0, min(k - _NEIGHBOURS, values.size - 2 * _NEIGHBOURS - 1))
        middle = float(np.median(values[low : low + 2 * _NEIGHBOURS + 1]))
        result[k] = middle + min(max(values[k] - middle, -_OFF * sigma[k]), _OFF * sigma[k])
    return result


def _cuts(count: int, kind: str) -> list[int]:
    """Runs before which a change may start: a step has a run on either side, a ramp may start at the first
    one."""
    first, last = (2, count - 2) if kind == "step" else (1, count - 3)
    if last < first:
        return []
    return sorted({round(float(k)) for k in np.linspace(first, last, min(last - first + 1, _CUTS))})


def _columns(kind: str, cut: int, over: Floats) -> Floats:
    if kind == "step":
        moved = (np.arange(over.size) >= cut).astype(float)
    else:
        moved = np.maximum(over - over[cut - 1], 0.0) / max(float(over[-1] - over[0]), 1e-300)
    return np.column_stack([np.ones(over.size), moved])


def _fitted(
    kind: str, cut: int, values: Floats, weights: Floats, over: Floats
) -> tuple[Floats, float, Floats]:
    """Coefficients, their χ², and their covariance."""
    columns = _columns(kind, cut, over)
    scaled = columns * weights[:, None]
    covariance = np.linalg.pinv(columns.T @ scaled, hermitian=True)
    coefficients = covariance @ (scaled.T @ values)
    residuals = values - columns @ coefficients
    return coefficients, float(np.sum(weights * np.square(residuals))), np.asarray(covariance, dtype=float)
