"""Which effects the data cannot tell apart: angles between what they would do to the readings."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.projected import Projected
from rigctl.model.fit.errors import whitened_residual
from rigctl.model.fit.fit import FitResult

Floats = NDArray[np.float64]

#: least separation at which the right one of two wins 99 times in 100
LEAST_SEPARATION = 2.33
#: least difference of mBIC at which one of two is a hundred times as probable
LEAST_DIFFERENCE = 9.2


def cosine(projected: Projected, one: int, other: int) -> float:
    """Cosine between two candidates' signatures: signed where both have one sign, else its size.

    With several parameters it is that of the smallest principal angle.
    """
    first, second = (_directions(projected, place) for place in (one, other))
    if not first.shape[1] or not second.shape[1]:
        return 0.0
    lin = projected.linearisation
    if first.shape[1] == second.shape[1] == 1:
        value = float((first.T @ second)[0, 0])
        signs = [lin.candidates[place].signs[0] for place in (one, other)]
        return value * signs[0] * signs[1] if all(signs) else abs(value)
    left, right = (np.linalg.qr(each)[0] for each in (first, second))
    return float(np.linalg.svd(left.T @ right, compute_uv=False)[0])


def separation(size: float, cos: float) -> float:
    """``d = λ·sqrt((1 − cos)/2)``: the right one of two wins with probability Φ(d)."""
    return size * math.sqrt(max(0.0, 0.5 * (1.0 - cos)))


def consistent_gain(best: FitResult, rival: FitResult) -> float:
    """How consistently one fit beats another over the records: ``Σ Δ_k / (√n·sd(Δ_k))``, Δ_k of their χ².

    Where neither model is right, a difference of χ² may come from a few records, and the noise's own
    distribution no longer tells its chance; the spread between records does. Infinite for a single record.

    Source: Q. H. Vuong, Likelihood ratio tests for model selection and non-nested hypotheses,
    Econometrica 57 (1989) 307.
    """
    differences = np.array(
        [
            float(np.square(whitened_residual(rival.problem, rival.outputs[k], k)).sum())
            - float(np.square(whitened_residual(best.problem, best.outputs[k], k)).sum())
            for k in best.fitted
        ]
    )
    if differences.size < 2:
        return math.inf
    spread = float(np.std(differences, ddof=1)) * math.sqrt(differences.size)
    return float(differences.sum()) / spread if spread > 0.0 else math.inf


def _directions(projected: Projected, place: int) -> Floats:
    columns = projected.linearisation.columns_of(place)
    usable = projected.usable[columns]
    matrix = projected.signatures[:, columns][:, usable]
    return np.asarray(matrix / projected.lengths[columns][usable])
