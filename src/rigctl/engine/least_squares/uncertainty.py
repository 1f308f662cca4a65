"""The covariance at the minimum, and the combinations of parameters that the data do not determine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.arrow import Arrow, Factors, Vector, eliminate
from rigctl.engine.least_squares.identifiability import WEAK, weak_combinations
from rigctl.engine.least_squares.result import LeastSquaresResult, Outcome
from rigctl.engine.least_squares.unknown import Unknown, prior_rows

Floats = NDArray[np.float64]

_ROUNDING = 1e-13


def conclude(
    arrow: Arrow,
    unknowns: tuple[Unknown, ...],
    local: Sequence[Sequence[Unknown]],
    point: Vector,
    *,
    cost: float,
    residual_count: int,
    outcome: Outcome,
    message: str,
    iterations: int,
    evaluations: int,
) -> LeastSquaresResult:
    """The result of a fit that ended at `point`, linearised there as `arrow`.

    Covariance: the inverse of JᵀJ with priors, over the parameters that are not held at a bound; for the
    shared ones with the records' own ones free (their Schur complement, by orthogonal elimination).
    """
    everyone = [*unknowns, *(unknown for record_local in local for unknown in record_local)]
    _, weight = prior_rows(everyone, point.flat())
    scale = np.maximum(arrow.norms().flat(), weight)
    scale[scale == 0.0] = 1.0
    free = _free(everyone, point.flat())
    size, mask = point.like(scale), point.like(free)
    nothing = point.like(np.zeros(scale.size))
    factors = eliminate(arrow.scaled(size), point.like(weight / scale), nothing, mask, nothing)
    chosen = mask.shared.astype(bool)
    names = [unknown.name for unknown, one in zip(unknowns, chosen, strict=True) if one]
    values, weak = weak_combinations(factors.matrix, np.ones(len(names)), names, size.shared[chosen])
    inverse = _inverse(factors.matrix)
    shared = np.zeros((len(unknowns), len(unknowns)))
    shared[np.ix_(chosen, chosen)] = inverse / np.outer(size.shared[chosen], size.shared[chosen])
    singular = np.zeros(len(unknowns))
    singular[chosen] = values
    return LeastSquaresResult(
        unknowns=unknowns,
        values=point.shared,
        local=point.local,
        cost=cost,
        residual_count=residual_count,
        parameter_count=int(free.sum()),
        covariance=shared,
        local_std=_local_std(factors, inverse, mask, size),
        at_bound=tuple(unknown.name for unknown, one in zip(unknowns, chosen, strict=True) if not one),
        singular_values=np.sort(singular)[::-1],
        weak=weak,
        outcome=outcome,
        message=message,
        iterations=iterations,
        evaluations=evaluations,
    )


def _free(everyone: Sequence[Unknown], values: Floats) -> Floats:
    """1 where a parameter lies inside its bounds, 0 where it is held at one."""
    inside = [unknown.lower < value < unknown.upper for unknown, value in zip(everyone, values, strict=True)]
    return np.array(inside, dtype=float)


def _inverse(matrix: Floats) -> Floats:
    """``(MᵀM)⁻¹``; infinite on the diagonal for parameters in a combination without any effect."""
    count = matrix.shape[1]
    if not count:
        return np.empty((0, 0))
    _, values, directions = np.linalg.svd(matrix, full_matrices=True)
    padded = np.zeros(count)
    padded[: values.size] = values
    determined = padded > _ROUNDING * max(1, matrix.shape[0]) * (padded.max() or 1.0)
    scaled = directions[determined] / padded[determined][:, None]
    inverse: Floats = scaled.T @ scaled
    lost = np.square(directions[~determined]).sum(axis=0) > WEAK
    inverse[lost, lost] = np.inf
    return inverse


def _local_std(factors: Factors, shared: Floats, mask: Vector, size: Vector) -> tuple[Floats, ...]:
    """Standard deviations of the record-level parameters: from noise, and propagated from the shared ones."""
    known = np.isfinite(np.diag(shared))  # undetermined parameters propagate nothing
    finite = np.where(np.outer(known, known), shared, 0.0)
    result = [np.zeros(record_local.size) for record_local in mask.local]
    for group in factors.groups:
        record_local = mask.local[group.records[0]].astype(bool)
        top = np.linalg.pinv(group.top)
        passed = top @ group.coupling
        variance = np.square(top).sum(axis=2) + np.einsum("rij,jk,rik->ri", passed, finite, passed)
        for index, each in zip(group.records, variance, strict=True):
            result[index][record_local] = np.sqrt(np.maximum(each, 0.0)) / size.local[index][record_local]
    return tuple(result)
