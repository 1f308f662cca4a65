"""Family-wise p-value: how often the best of everything searched looks as good by chance alone.

For hypotheses k with orthonormal columns U_k, by chance ``z ~ N(0, M)``, M = UᵀU over all of them together,
and ``χ²_k = |z_k|²``. The null distribution of the smallest p-value is simulated, so that similar hypotheses
count according to their correlation.

The noise of the readings is whitened, but not all of it is known. The residuals beside the best term are
therefore also resampled, with a random sign for each record (a block bootstrap): if they vary more than white
noise, the larger p-value counts.
Source: J. Westfall, S. S. Young, Resampling-Based Multiple Testing (1993); R. Davidson, E. Flachaire,
J. Econometrics 146 (2008) 162, for the signs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.nuisance_projection import HIDDEN, Projected

Floats = NDArray[np.float64]

#: number of draws of the null distribution
DRAWS = 20_000
#: with fewer records, random signs have no more than some dozens of outcomes
_FEW_RECORDS = 7
_BATCH = 2000
#: directions of a set of columns that are shorter than this share of the longest are dropped
_RANK = 1e-3
#: directions of M below this are rounding errors
_ROUNDING = 1e-9


def span(projected: Projected, chosen: slice) -> Floats:
    """(rows, dof) orthonormal basis of some of the columns, with the fitted unknowns projected off."""
    usable = projected.usable[chosen]
    columns = projected.signatures[:, chosen][:, usable]
    if not columns.shape[1]:
        return np.empty((columns.shape[0], 0))
    full = projected.linearisation.full_lengths[chosen][usable]
    left, values, _ = np.linalg.svd(columns / full, full_matrices=False)
    return np.asarray(left[:, values > max(_RANK * values[0], HIDDEN)])


@dataclass(frozen=True)
class Chance:
    """Null distribution of the smallest p-value of a search.

    Attributes
    ----------
    tests: number of hypotheses searched.
    least: (draws) the smallest p-value of each draw of white noise, sorted.
    left: (draws) those of the residuals beside the best term with random signs; None if not drawn.
    more: number of further hypotheses that were searched but not simulated: they count in full, by
        Bonferroni's bound.
    """

    tests: int
    least: Floats
    left: Floats | None
    more: int = 0

    def family_wise(self, p_value: float) -> float:
        """The p-value of one hypothesis selected from all for its p-value.

        The share of draws with as small a value; if there is none, at most Bonferroni's bound.
        """
        white = min(_share(self.least, p_value), self.tests * p_value)
        drawn = max(white, 0.0 if self.left is None else _share(self.left, p_value))
        return min(1.0, drawn + self.more * p_value)

    @property
    def independent(self) -> float:
        """The number of independent tests to which the search is equivalent, at a level of 1 %."""
        level = float(np.quantile(self.least, 0.01))
        drawn = float(np.log1p(-0.01) / np.log1p(-level)) if 0.0 < level < 1.0 else float(self.tests)
        return drawn + self.more


def _share(drawn: Floats, p_value: float) -> float:
    return (1.0 + float(np.searchsorted(drawn, p_value, side="right"))) / (1.0 + drawn.size)


def draw_chance(projected: Projected, groups: Sequence[slice], seed: int = 0) -> Chance:
    """The null distribution of a search over groups of columns."""
    bases = [span(projected, group) for group in groups]
    bases = [basis for basis in bases if basis.shape[1]]
    rng = np.random.Generator(np.random.PCG64(seed))
    if not bases:
        return Chance(0, np.ones(DRAWS), None)
    every = np.hstack(bases)
    ends = np.cumsum([basis.shape[1] for basis in bases])
    known = projected.noise_degrees
    values, vectors = np.linalg.eigh(every.T @ every)
    nonzero = values > _ROUNDING * values[-1]
    root = vectors[:, nonzero] * np.sqrt(values[nonzero])
    white = _least(lambda n: rng.standard_normal((n, root.shape[1])) @ root.T, ends, known, rng)
    return Chance(len(bases), white, _sign_flipped_minima(projected, bases, ends, rng))


def _sign_flipped_minima(
    projected: Projected, bases: Sequence[Floats], ends: NDArray[np.intp], rng: np.random.Generator
) -> Floats | None:
    """Draws of the smallest p-value with a random sign for the residuals of each record."""
    counts = [one.residual.size for one in projected.linearisation.records]
    if len(counts) < _FEW_RECORDS:
        return None
    residual = projected.residual
    best = min(bases, key=lambda basis: _p_values(np.square(basis.T @ residual).sum(), basis.shape[1], 0))
    remaining = residual - best @ (best.T @ residual)
    every = np.hstack(list(bases))
    rows = np.cumsum([0, *counts])
    parts = np.array([remaining[a:b] @ every[a:b] for a, b in pairwise(rows.tolist())])
    return _least(lambda n: rng.choice([-1.0, 1.0], (n, len(counts))) @ parts, ends, 0, rng)


def _least(
    draw: Callable[[int], Floats], ends: NDArray[np.intp], known: int, rng: np.random.Generator
) -> Floats:
    dofs = np.diff([0, *ends])
    explained = np.empty(DRAWS)
    for first in range(0, DRAWS, _BATCH):
        squares = np.square(draw(_BATCH))
        sums = np.add.reduceat(squares, [0, *ends[:-1]], axis=1)
        if known:  # the noise is itself an estimate
            sums = sums / (rng.chisquare(known, (_BATCH, 1)) / known)
        least = np.ones(_BATCH)
        for dof in np.unique(dofs):
            largest = sums[:, dofs == dof].max(axis=1)
            least = np.minimum(least, _p_values(largest, int(dof), known))
        explained[first : first + _BATCH] = least
    return np.sort(explained)


def _p_values(statistic: Floats, dof: int, known: int) -> Floats:
    from scipy.special import fdtrc, gammaincc

    if known:
        return np.asarray(fdtrc(dof, known, statistic / dof))
    return np.asarray(gammaincc(0.5 * dof, 0.5 * statistic))
