"""Noise of a table: what neighbouring rows do not have in common with a smooth curve through them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: neighbouring points of one difference: with their quadratic taken out, one number is left
POINTS = 4
#: so much less with one point more, and the cubic taken out too, is no chance: from 11 rows on, noise alone
#: does so in less than one table of 10 000
_BENDS = 0.5
#: differences that a number can be read from
FEWEST = 6
#: values that span more than this factor are read with an error that is a share of the value
_SPANS = 3.0


@dataclass(frozen=True)
class RowNoise:
    """The scatter of single values about a smooth curve.

    Parameters
    ----------
    sigma: standard deviation of one value: SI, or where `relative` a share of the value.
    relative: the scatter is a share of the value.
    differences: how many it was read from; `repeats` of them between rows at one point.
    degrees: of freedom behind sigma: differences overlap, so these are fewer.
    """

    sigma: float
    relative: bool
    differences: int
    repeats: int
    degrees: int


def is_relative(values: Floats) -> bool:
    """Whether the noise of these values is a share of each: all are positive, and they span a factor of 3."""
    present = values[np.isfinite(values)]
    return bool(present.size and present.min() > 0.0 and present.max() > _SPANS * present.min())


def row_noise(points: Floats, values: Floats, series: NDArray[np.intp]) -> RowNoise | None:
    """The noise of one column of a table, without any model.

    Of each four neighbouring points x_1 … x_4 the one combination ``d = w·y``, ``|w| = 1``, is taken that no
    quadratic in x shows (``Σ w = Σ w·x = Σ w·x² = 0``; at equal steps the third difference over √20): of
    independent values it has the variance σ², and what a curve adds is its departure from a quadratic over
    four points, at equal steps h ``h³·y‴/√20``. Where five points without their cubic show less than half of
    that scatter, it was the curve's, and theirs is taken. What stays is a floor, below which noise cannot be
    read: for the viscosity of a mineral oil over 13 rows 0.002 % from 20 to 80 °C and 0.05 % from −20 to
    100 °C; of 9 rows, too few for differences of five points, 0.07 % and 1 %. Noise is then read too wide,
    and an effect has to be larger to show.

    Differences between rows at one point have the variance σ² too; their mean then stands for the point. y is
    ln(value) where the noise is a share of the value. ``σ² = mean d²``, and as rows occur in several d its
    degrees of freedom are ``tr(Q)²/tr(Q²)``, Q the matrix of the products of all w.

    Parameters
    ----------
    points: (rows) what the rows are ordered by, in any unit.
    values: (rows) SI; NaN where a value is missing.
    series: (rows) rows of one number lie on one curve.

    Returns
    -------
    None where there are fewer than `FEWEST` differences, or no scatter at all.

    Source: von Neumann et al., Ann. Math. Stat. 12 (1941) 153; Gasser, Sroka & Jennen-Steinmetz, Biometrika
    73 (1986) 625; Satterthwaite, Biometrics Bulletin 2 (1946) 110.
    """
    relative = is_relative(values)
    logs = np.log(np.where(values > 0.0, values, np.nan)) if relative else values
    present = np.where(np.isfinite(logs), logs, 0.0)
    weights = _contrasts(points, logs, series)
    if len(weights) < FEWEST:
        return None
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
    found: list[Floats] = []
    for one in np.unique(series):
        rows = np.flatnonzero((series == one) & np.isfinite(values) & np.isfinite(points))
        xs = np.unique(points[rows])
        means = np.zeros((xs.size, values.size))
        for number, x in enumerate(xs):
            repeats = rows[points[rows] == x]
            means[number, repeats] = 1.0 / repeats.size
            found += _helmert(repeats, values.size)
        for first in range(xs.size - size + 1):
            chosen = slice(first, first + size)
            centred = (xs[chosen] - xs[chosen].mean()) / np.ptp(xs[chosen])
            weight = np.linalg.svd(np.vander(centred, size - 1).T)[2][-1] @ means[chosen]
            found.append(weight / np.linalg.norm(weight))
    return np.array(found).reshape(-1, values.size)


def _helmert(rows: NDArray[np.intp], size: int) -> list[Floats]:
    """Of m repeats the m − 1 differences of each to the mean of those before it, of unit length."""
    found = []
    for k in range(1, rows.size):
        weight = np.zeros(size)
        weight[rows[:k]], weight[rows[k]] = 1.0, -float(k)
        found.append(weight / np.sqrt(k * (k + 1.0)))
    return found


def same_reading(one: Floats, other: Floats, points: Floats, series: NDArray[np.intp]) -> bool:
    """Whether a column was worked out from another: what scatters in the one scatters alike in the other.

    True when the ratio of the two has less than a twentieth of the scatter that each of them has: then their
    errors are correlated by more than 0.998, and the second says nothing new.
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
