"""z-maps: the residual of every record × phase × channel, in standard deviations of chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.projected import Projected

Floats = NDArray[np.float64]

_DRAWS = 4000
#: with more cells than this the largest is judged by Bonferroni's bound instead of by drawing
_MOST_DRAWN = 1500
#: a cell of which less than this share of the variance is left says nothing
_LEAST_VARIANCE = 1e-3


@dataclass(frozen=True)
class CellMap:
    """Every cell, and the distribution of the largest of any of them.

    Attributes
    ----------
    z: (records, regions) sums of the whitened residuals over a region, in standard deviations; NaN where the
        record has no reading there, or the fit leaves none.
    draws: (draws, cells) what chance makes of the cells that are not NaN, in order; empty when there are too
        many of them.
    noise_degrees: degrees of freedom behind the noise of a table, which the draws know of; 0 where it counts
        as known.
    """

    z: Floats
    draws: Floats = field(repr=False)
    noise_degrees: int = 0

    @property
    def here(self) -> NDArray[np.bool_]:
        """(records, regions) where there is a value."""
        return np.isfinite(self.z)

    @cached_property
    def _largest(self) -> Floats:
        """(draws) the largest of all the cells."""
        return np.asarray(np.abs(self.draws).max(axis=1))

    def p_value(self, chosen: NDArray[np.bool_]) -> float:
        """How often chance alone makes any cell as large as the largest of the chosen ones is.

        Of any cell, not of the chosen ones alone: these are looked at because they are the largest of many.
        Parametric bootstrap.
        """
        used = chosen & self.here
        if not used.any():
            return 1.0
        count = int(self.here.sum())
        largest = float(np.abs(self.z[used]).max())
        single = _two_sided(largest)
        bound = 1.0 - (1.0 - single) ** count if single > 1e-12 else count * single
        if not self.draws.size:
            return float(bound)
        drawn = self._largest
        reached = float((drawn >= largest).mean())
        if self.noise_degrees:
            return max(reached, 1.0 / len(drawn))
        return reached if reached * len(drawn) >= 20 else min(float(bound), max(reached, 20.0 / len(drawn)))

    def share(self, chosen: NDArray[np.bool_]) -> float:
        """The chosen cells' share of what is systematic: ``Σ max(z² − 1, 0)`` over that of all."""
        excess = np.where(self.here, np.maximum(np.nan_to_num(self.z) ** 2 - 1.0, 0.0), 0.0)
        total = float(excess.sum())
        return float(excess[chosen].sum()) / total if total > 0.0 else 0.0


def cell_map(projected: Projected, seed: int = 0) -> CellMap:
    """The cells of a projected linearisation.

    With E_k the regions' unit columns of record k, ``z = E_kᵀr̃ / √diag G`` and their covariance is
    ``G_kl = δ_kl·E_kᵀE_k − (Q_kᵀE_k)ᵀ(Q_lᵀE_l)``, Q the orthonormal basis of the shared unknowns.
    """
    lin = projected.linearisation
    sums, couplings, squares = [], [], []
    row = 0
    for k in projected.places:
        regions = lin.records[k].regions
        rows = slice(row, row + regions.shape[0])
        row = rows.stop
        sums.append(regions.T @ projected.residual[rows])
        couplings.append(projected.basis[rows].T @ regions)
        squares.append(regions.T @ regions)
    variance = np.array(
        [np.diag(square) - np.square(c).sum(axis=0) for square, c in zip(squares, couplings, strict=True)]
    )
    here = variance > _LEAST_VARIANCE
    root = np.sqrt(np.where(here, variance, 1.0))
    z = np.where(here, np.array(sums) / root, np.nan)
    draws, degrees = _draws(squares, couplings, here, root, seed), projected.noise_degrees
    if degrees and draws.size:
        generator = np.random.Generator(np.random.PCG64([seed, degrees]))
        draws = draws * np.sqrt(degrees / generator.chisquare(degrees, (draws.shape[0], 1)))
    return CellMap(z, draws, degrees)


def _draws(
    squares: Sequence[Floats], couplings: Sequence[Floats], here: NDArray[np.bool_], root: Floats, seed: int
) -> Floats:
    count = int(here.sum())
    if not 0 < count <= _MOST_DRAWN:
        return np.empty((0, count))
    ends = np.cumsum([0, *here.sum(axis=1)])
    covariance = np.zeros((count, count))
    for k, square in enumerate(squares):
        own = slice(ends[k], ends[k + 1])
        covariance[own, own] = square[np.ix_(here[k], here[k])]
    coupling = np.concatenate([c[:, keep] for c, keep in zip(couplings, here, strict=True)], axis=1)
    covariance -= coupling.T @ coupling
    scale = root[here]
    values, vectors = np.linalg.eigh(covariance / scale[:, None] / scale[None, :])
    normal = np.random.Generator(np.random.PCG64(seed)).standard_normal((_DRAWS, count))
    return np.asarray(normal @ (vectors * np.sqrt(np.maximum(values, 0.0))).T)


def _two_sided(z: float) -> float:
    from math import erfc, sqrt

    return erfc(z / sqrt(2.0))
