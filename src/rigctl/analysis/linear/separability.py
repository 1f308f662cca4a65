"""Which effects the data cannot distinguish: angles between their signatures in the readings."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import LEAST_DIFFERENCE, TOLERANCE
from rigctl.analysis.linear.nuisance_projection import Projected
from rigctl.model.fit.errors import whitened_residual
from rigctl.model.fit.fit import FitResult

Floats = NDArray[np.float64]


def cosine(projected: Projected, one: int, other: int) -> float:
    """Cosine between two candidates' signatures: signed if each effect has one sign only, else its magnitude.

    With several parameters, that of the smallest principal angle.
    """
    first, second = (directions(projected, index) for index in (one, other))
    if not first.shape[1] or not second.shape[1]:
        return 0.0
    lin = projected.linearisation
    if first.shape[1] == second.shape[1] == 1:
        value = float((first.T @ second)[0, 0])
        signs = [lin.candidates[index].signs[0] for index in (one, other)]
        return value * signs[0] * signs[1] if all(signs) else abs(value)
    left, right = (np.linalg.qr(each)[0] for each in (first, second))
    return float(np.linalg.svd(left.T @ right, compute_uv=False)[0])


def separation(size: float, cos: float) -> float:
    """``d = λ·sqrt((1 − cos)/2)``: the right one of two effects wins with probability Φ(d)."""
    return size * math.sqrt(max(0.0, 0.5 * (1.0 - cos)))


def softened(reached: float) -> float:
    """The factor by which differences of χ² are discounted: ``max(1, TOLERANCE²·reached/LEAST_DIFFERENCE)``.

    `reached` is the reduction of χ² by the effects. With it, a difference of the share `TOLERANCE²` of that
    reduction equals `LEAST_DIFFERENCE`, the least that distinguishes two effects.
    """
    return max(1.0, TOLERANCE**2 * reached / LEAST_DIFFERENCE)


def consistent_gain(best: FitResult, rival: FitResult, rivals: int = 1) -> float:
    """How consistently one fit beats another over the conditions, in standard deviations.

    ``t = Σ Δ_g/(√G·sd(Δ_g))``, Δ_g being the difference of their χ² over all records of condition g. The
    result is the normal deviate with the tail probability of t by Student's distribution with G − 1 degrees
    of freedom, times `rivals` (Bonferroni), because the nearest of so many is considered. If neither model is
    right, a difference of χ² may come from a few conditions, and the noise distribution no longer gives its
    probability; the spread between conditions does. With one condition its records count; infinite for a
    single record.

    Source: Q. H. Vuong, Likelihood ratio tests for model selection and non-nested hypotheses,
    Econometrica 57 (1989) 307; clustered as in A. C. Cameron and D. L. Miller, J. Human Resources 50 (2015)
    317.
    """
    from scipy.special import ndtri, stdtr

    # Δ_g, summed over the records of a condition: these share what both models lack there, and are not
    # independent observations of which model is better.
    groups = [best.problem.records[k].group for k in best.fitted]
    if len(set(groups)) < 2:
        groups = list(range(len(best.fitted)))
    sums: dict[int, float] = {}
    for group, k in zip(groups, best.fitted, strict=True):
        rival_residual = whitened_residual(rival.problem, rival.outputs[k], k)
        best_residual = whitened_residual(best.problem, best.outputs[k], k)
        sums[group] = (
            sums.get(group, 0.0)
            + float(rival_residual @ rival_residual)
            - float(best_residual @ best_residual)
        )
    differences = np.array(list(sums.values()))
    if differences.size < 2:
        return math.inf
    spread = float(np.std(differences, ddof=1)) * math.sqrt(differences.size)
    if spread == 0.0:
        return math.inf
    t = float(differences.sum()) / spread
    chance = min(1.0, max(rivals, 1) * float(stdtr(differences.size - 1, -t)))
    return float(-ndtri(chance)) if chance > 0.0 else math.inf


def directions(projected: Projected, index: int) -> Floats:
    """(rows, parameters) a candidate's visible signatures, scaled to unit length."""
    columns = projected.linearisation.columns_of(index)
    usable = projected.usable[columns]
    matrix = projected.signatures[:, columns][:, usable]
    return np.asarray(matrix / projected.lengths[columns][usable])
