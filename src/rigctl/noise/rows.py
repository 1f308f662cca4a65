"""Noise of a table: the deviations of neighbouring rows from a smooth curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: number of neighbouring points in one difference: without their quadratic, one number is left
POINTS = 4
#: such a ratio with one more point, and the cubic removed too, is significant: from 11 rows on, noise alone
#: shows it in less than one table in 10 000
_BENDS = 0.5
#: least number of differences
FEWEST = 6
#: values that span more than this factor are read with a relative error
_SPANS = 3.0


@dataclass(frozen=True)
class RowNoise:
    """The scatter of single values about a smooth curve.

    Parameters
    ----------
    sigma: standard deviation of one value: SI, or if `relative` a share of the value.
    relative: whether the scatter is a share of the value.
    differences: their number; `repeats` of them between rows at one point.
    degrees: of freedom of sigma, fewer because differences overlap.
    """

    sigma: float
    relative: bool
    differences: int
    repeats: int
    degrees: int


def is_relative(values: Floats) -> bool:
    """Whether the noise of these values is a share of each: if all are positive and span a factor of 3."""
    present = values[np.isfinite(values)]
    return bool(present.size and present.min() > 0.0 and present.max() > _SPANS * present.min())


def row_noise(points: Floats, values: Floats, series: NDArray[np.intp]) -> RowNoise | None:
    """The noise of one column of a table, without any model.

    For each four neighbouring points x_1 … x_4 the combination ``d = w·y``, ``|w| = 1``, is used to which no
    quadratic in x contributes (``Σ w = Σ w·x = Σ w·x² = 0``; at equal steps the third difference over √20):
    for independent values it has the variance σ², and the contribution of a curve is its departure from a
    quadratic over four points, at equal steps h ``h³·y‴/√20``. If five points without their cubic show less
    than half of that scatter, it was due to the curve, and theirs is used. The rest is a floor below which
    noise cannot be determined: for the viscosity of a mineral oil over 13 rows 0.002 % from 20 to 80 °C and
    0.05 % from −20 to 100 °C; with 9 rows, too few for differences of five points, 0.07 % and 1 %. The noise
    is then overestimated, and an effect must be larger to be detected.

    Differences between rows at one point have the variance σ² too; their mean then represents the point. y is
    ln(value) if the noise is a share of the value. ``σ² = mean d²``, and as rows occur in several d its
    degrees of freedom are ``tr(Q)²/tr(Q²)``, Q the matrix of the products of all w.

    Parameters
    ----------
    points: (rows) the variable by which the rows are ordered, in any unit.
    values: (rows) SI; NaN if a value is missing.
    series: (rows) rows with one number lie on one curve.

    Returns
    -------
    None if there are fewer than `FEWEST` differences, or no scatter at all.

    Source: von Neumann et al., Ann. Math. Stat. 12 (1941) 153; Gasser, Sroka & Jennen-Steinmetz, Biometrika
    73 (1986) 625; Satterthwaite, Biometrics Bulletin 2 (1946) 110.
    """
    relative = is_relative(values)
    logs = np.log(np.where(values > 0.0, values, np.nan)) if relative else values
    present = np.where(np.isfinite(logs), logs, 0.0)
    weights = _contrasts(points, logs, series)
    if len(weights) < FEWEST:
        return None
    # Four points without their quadratic; five without their cubic, if that shows less than half: then a
    # curve made up the difference.
    sigma = _scatter(weights @ present)
    longer = _contrasts(points, logs, series, POINTS + 1)
    if len(longer) >= FEWEST and _scatter(longer @ present) < _BENDS * sigma:
        weights, sigma = longer, _scatter(longer @ present)
    if sigma <= 1e-12 * float(np.nanmax(np.abs(logs))):
        return None
    products = weights @ weights.T
    degrees = float(np.trace(products) ** 2 / np.sum(products**2))
    repeats = sum(int(np.ptp(points[weight != 0.0]) == 0.0) for weight in weights)
    return RowNoise(sigma, relative, len(weights), repeats, max(1, int(degrees)))


def _scatter(differences: Floats) -> float:
    return float(np.sqrt(np.mean(differences**2)))


def _contrasts(points: Floats, values: Floats, series: NDArray[np.intp], size: int = POINTS) -> Floats:
    """(differences, rows) the weights of each difference: between repeats, and of `size` neighbours."""
    weights: list[Floats] = []
    for one in np.unique(series):
        rows = np.flatnonzero((series == one) & np.isfinite(values) & np.isfinite(points))
        xs = np.unique(points[rows])
        means = np.zeros((xs.size, values.size))
        for number, x in enumerate(xs):
            repeats = rows[points[rows] == x]
            means[number, repeats] = 1.0 / repeats.size
            weights += _helmert(repeats, values.size)
        for first in range(xs.size - size + 1):
            chosen = slice(first, first + size)
            centred = (xs[chosen] - xs[chosen].mean()) / np.ptp(xs[chosen])
            weight = np.linalg.svd(np.vander(centred, size - 1).T)[2][-1] @ means[chosen]
            weights.append(weight / np.linalg.norm(weight))
    return np.array(weights).reshape(-1, values.size)


def _helmert(rows: NDArray[np.intp], size: int) -> list[Floats]:
    """For m repeats the m − 1 differences of each to the mean of those before it, of unit length."""
    weights = []
    for k in range(1, rows.size):
        weight = np.zeros(size)
        weight[rows[:k]], weight[rows[k]] = 1.0, -float(k)
        weights.append(weight / np.sqrt(k * (k + 1.0)))
    return weights


def same_reading(one: Floats, other: Floats, points: Floats, series: NDArray[np.intp]) -> bool:
    """Whether a column was computed from another: the scatter of the one follows that of the other.

    True if the ratio of the two has less than a twentieth of the scatter of each: then their errors have a
    correlation above 0.998, and the second adds no information.
    """
    if not (is_relative(one) and is_relative(other)):
        return False
    logs = [np.log(np.where(column > 0.0, column, np.nan)) for column in (one, other)]
    ratio = logs[1] - logs[0]
    weights = _contrasts(points, ratio, series)
    if len(weights) < FEWEST:
        return False
    alone, common = (
        float(np.mean((weights @ np.where(np.isfinite(column), column, 0.0)) ** 2))
        for column in (logs[0], ratio)
    )
    return common < 0.05**2 * alone
