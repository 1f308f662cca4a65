"""How often chance alone makes the best of everything that was searched look as good: a family-wise p-value.

Of hypotheses k with orthonormal columns U_k, chance makes ``z ~ N(0, M)``, M = UᵀU over all of them together,
and ``χ²_k = |z_k|²``. The smallest p-value of all is drawn so many times: hypotheses that are alike count
once, by as much as they are alike.

The noise of readings is whitened, but not all of it is known. What is left beside the best term is therefore
also drawn as it is, with a random sign for each record (the blocks of a bootstrap): where that varies more
than white noise does, it counts.

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

#: draws of what chance does
DRAWS = 20_000
#: at so few records the signs of all have no more than some dozens of outcomes
_FEW_RECORDS = 7
_BATCH = 2000
#: of a set of columns, directions shorter than this share of the longest are none
_RANK = 1e-3
#: of M, directions that are no more than rounding
_ROUNDING = 1e-9


def span(projected: Projected, chosen: slice) -> Floats:
    """(rows, dof) orthonormal basis of some of the columns; without what the fitted unknowns can do."""
    usable = projected.usable[chosen]
    columns = projected.signatures[:, chosen][:, usable]
    if not columns.shape[1]:
        return np.empty((columns.shape[0], 0))
    full = projected.linearisation.full_lengths[chosen][usable]
    left, values, _ = np.linalg.svd(columns / full, full_matrices=False)
    return np.asarray(left[:, values > max(_RANK * values[0], HIDDEN)])


@dataclass(frozen=True)
class Chance:
    """What chance makes of the smallest p-value of a search.

    Attributes
    ----------
    tests: how many hypotheses were searched.
    least: (draws) the smallest p-value of each draw of white noise, in order.
    left: the same of what is left beside the best term with random signs; None where it was not drawn.
    more: hypotheses that were searched besides and not drawn: they count in full, by Bonferroni's bound.
    """

    tests: int
    least: Floats
    left: Floats | None
    more: int = 0

    def family_wise(self, p_value: float) -> float:
        """The p-value of one hypothesis, chosen from all for its p-value.

        The share of draws that are as small; where none is, no more than Bonferroni's bound says.
        """
        white = min(_share(self.least, p_value), self.tests * p_value)
        drawn = max(white, 0.0 if self.left is None else _share(self.left, p_value))
        return min(1.0, drawn + self.more * p_value)

    @property
    def independent(self) -> float:
        """As how many independent tests the search behaves, at a level of 1 %."""
        level = float(np.quantile(self.least, 0.01))
        drawn = float(np.log1p(-0.01) / np.log1p(-level)) if 0.0 < level < 1.0 else float(self.tests)
        return drawn + self.more


def _share(drawn: Floats, p_value: float) -> float:
    return (1.0 + float(np.searchsorted(drawn, p_value, side="right"))) / (1.0 + drawn.size)


def draw_chance(projected: Projected, groups: Sequence[slice], seed: int = 0) -> Chance:
    """What chance makes of a search over groups of columns."""
    bases = [span(projected, group) for group in groups]
    bases = [basis for basis in bases if basis.shape[1]]
    rng = np.random.Generator(np.random.PCG64(seed))
    if not bases:
        return Chance(0, np.ones(DRAWS), None)
    every = np.hstack(bases)
    ends = np.cumsum([basis.shape[1] for basis in bases])
    known = projected.noise_degrees
    values, vectors = np.linalg.eigh(every.T @ every)
    kept = values > _ROUNDING * values[-1]
    root = vectors[:, kept] * np.sqrt(values[kept])
    white = _least(lambda n: rng.standard_normal((n, root.shape[1])) @ root.T, ends, known, rng)
    return Chance(len(bases), white, _of_what_is_left(projected, bases, ends, rng))


def _of_what_is_left(
    projected: Projected, bases: Sequence[Floats], ends: NDArray[np.intp], rng: np.random.Generator
) -> Floats | None:
    """Draws of the smallest p-value with a random sign for what is left in each record."""
    counts = [one.residual.size for one in projected.linearisation.records]
    if len(counts) < _FEW_RECORDS:
        return None
    residual = projected.residual
    best = min(bases, key=lambda basis: _p_values(np.square(basis.T @ residual).sum(), basis.shape[1], 0))
    left = residual - best @ (best.T @ residual)
    every = np.hstack(list(bases))
    rows = np.cumsum([0, *counts])
    parts = np.array([left[a:b] @ every[a:b] for a, b in pairwise(rows.tolist())])
    return _least(lambda n: rng.choice([-1.0, 1.0], (n, len(counts))) @ parts, ends, 0, rng)


def _least(
    draw: Callable[[int], Floats], ends: NDArray[np.intp], known: int, rng: np.random.Generator
) -> Floats:
    dofs = np.diff([0, *ends])
    explained = np.empty(DRAWS)
    for first in range(0, DRAWS, _BATCH):
        squares = np.square(draw(_BATCH))
        sums = np.add.reduceat(squares, [0, *ends[:-1]], axis=1)
        if known:  # the noise is a guess itself
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
