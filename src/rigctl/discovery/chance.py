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

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigctl.analysis.linear.nuisance_projection import HIDDEN, Projected

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
#: below this p-value its logarithm is computed from the expansion for large statistics, as p underflows
_TINY = 1e-280


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
    least: (draws) logarithm of the smallest p-value of each draw of white noise, sorted.
    left: (draws) those of the residuals beside the best term with random signs; None if not drawn.
    more: number of further hypotheses that were searched but not simulated: they count in full, by
        Bonferroni's bound.
    """

    tests: int
    least: Floats
    left: Floats | None
    more: int = 0

    def family_wise(self, log_p: float) -> float:
        """The p-value of one hypothesis selected from all for its p-value, of which the logarithm is given.

        The share of draws with as small a value; if there is none, at most Bonferroni's bound.
        """
        p_value = math.exp(log_p)
        white = min(_share(self.least, log_p), self.tests * p_value)
        drawn = max(white, 0.0 if self.left is None else _share(self.left, log_p))
        return min(1.0, drawn + self.more * p_value)

    @property
    def independent(self) -> float:
        """The number of independent tests to which the search is equivalent, at a level of 1 %."""
        level = self.level(0.01)
        drawn = float(np.log1p(-0.01) / np.log1p(-level)) if 0.0 < level < 1.0 else float(self.tests)
        return drawn + self.more

    def level(self, alpha: float) -> float:
        """The p-value that the best of the search has by chance with probability `alpha`."""
        return math.exp(float(np.quantile(self.least, alpha)))


def _share(drawn: Floats, log_p: float) -> float:
    return (1.0 + float(np.searchsorted(drawn, log_p, side="right"))) / (1.0 + drawn.size)


def draw_chance(projected: Projected, groups: Sequence[slice], seed: int = 0) -> Chance:
    """The null distribution of a search over groups of columns."""
    bases = [span(projected, group) for group in groups]
    bases = [basis for basis in bases if basis.shape[1]]
    rng = np.random.Generator(np.random.PCG64(seed))
    if not bases:
        return Chance(0, np.zeros(DRAWS), None)
    # M = UᵀU over all hypotheses: z = M^(1/2)·n has the correlations of the search, since hypotheses at one
    # slot, or over similar variables, are hardly different tests.
    every = np.hstack(bases)
    ends = np.cumsum([basis.shape[1] for basis in bases])
    known = projected.noise_degrees
    values, vectors = np.linalg.eigh(every.T @ every)
    kept = values > _ROUNDING * values[-1]
    root = vectors[:, kept] * np.sqrt(values[kept])
    white = _least(lambda n: rng.standard_normal((n, root.shape[1])) @ root.T, ends, known, rng, white=True)
    return Chance(len(bases), white, _sign_flipped_minima(projected, bases, ends, rng))


def _sign_flipped_minima(
    projected: Projected, bases: Sequence[Floats], ends: NDArray[np.intp], rng: np.random.Generator
) -> Floats | None:
    """Draws of the smallest p-value with a random sign for the residuals of each record."""
    counts = [one.residual.size for one in projected.linearisation.records]
    if len(counts) < _FEW_RECORDS:
        return None
    residual, known = projected.residual, projected.noise_degrees
    # The best term is taken out first: left in the residuals, it would pass for their chance variation.
    best = min(
        bases, key=lambda basis: log_tail(np.square(basis.T @ residual).sum(), basis.shape[1], known).item()
    )
    left = residual - best @ (best.T @ residual)
    every = np.hstack(list(bases))
    rows = np.cumsum([0, *counts])
    parts = np.array([left[a:b] @ every[a:b] for a, b in pairwise(rows.tolist())])
    return _least(lambda n: rng.choice([-1.0, 1.0], (n, len(counts))) @ parts, ends, known, rng, white=False)


def _least(
    draw: Callable[[int], Floats],
    ends: NDArray[np.intp],
    known: int,
    rng: np.random.Generator,
    *,
    white: bool,
) -> Floats:
    dofs = np.diff([0, *ends])
    explained = np.empty(DRAWS)
    for first in range(0, DRAWS, _BATCH):
        squares = np.square(draw(_BATCH))
        sums = np.add.reduceat(squares, [0, *ends[:-1]], axis=1)
        if known and white:  # the noise is itself an estimate; residuals bring their own scale
            sums = sums / (rng.chisquare(known, (_BATCH, 1)) / known)
        least = np.zeros(_BATCH)
        # p falls with χ² at given degrees of freedom: of the hypotheses with as many, only the largest χ² is
        # needed.
        for dof in np.unique(dofs):
            largest = sums[:, dofs == dof].max(axis=1)
            least = np.minimum(least, log_tail(largest, int(dof), known))
        explained[first : first + _BATCH] = least
    return np.sort(explained)


def log_tail(statistic: ArrayLike, dof: int, known: int = 0) -> Floats:
    """Logarithm of the probability that χ² with `dof` degrees of freedom is at least `statistic`.

    If the noise has only `known` degrees of freedom, that of ``dof·F(dof, known)``. Effects of some dozens of
    sigmas have p-values below the smallest float: without the logarithm, all would be equally improbable.
    """
    from scipy.special import betaln, fdtrc, gammaincc, gammaln

    size = np.maximum(np.asarray(statistic, dtype=float), 0.0)
    a = 0.5 * dof
    p_values = np.asarray(fdtrc(dof, known, size / dof) if known else gammaincc(a, 0.5 * size))
    far = np.maximum(size, 4.0 * dof + 4.0)  # where p is tiny, `size` itself
    if known:
        b, y = 0.5 * known, known / (known + far)
        beyond = b * np.log(y) + a * np.log1p(-y) - math.log(b) - betaln(b, a)
        beyond = beyond - np.log1p(-y * (a + b) / (b + 1.0))
    else:
        x = 0.5 * far
        beyond = a * np.log(x) - x - gammaln(a) - np.log(x + 1.0 - a)
    return np.asarray(np.where(p_values > _TINY, np.log(np.maximum(p_values, _TINY)), beyond))
