"""The covariance at the minimum, and the combinations of parameters that the data do not determine.

In: the iterate at which a fit ended, or residuals and derivatives at a minimum. Out: the result of the
fit, with standard deviations of shared and record-level parameters; and how a minimum would move with
other causes, such as errors of calibrations.

The records' own unknowns are eliminated first, record by record, by orthogonal transformations: JᵀJ would
square the condition number. Columns are scaled to length 1, so that singular values compare directions
and not units. What lies in a direction without effect gets an infinite variance, and no number that only
rounding has made finite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.arrow import Arrow, Factors, Vector, eliminate, reduce_blocks
from rigctl.engine.least_squares.block import Block
from rigctl.engine.least_squares.identifiability import WEAK, weak_combinations
from rigctl.engine.least_squares.result import LeastSquaresResult, Outcome
from rigctl.engine.least_squares.state import Iterate
from rigctl.engine.least_squares.unknown import Unknown, prior_rows

Floats = NDArray[np.float64]

_ROUNDING = 1e-13


def conclude(
    at: Iterate, outcome: Outcome, message: str, *, iterations: int, evaluations: int
) -> LeastSquaresResult:
    """The result of a fit that ended at an iterate."""
    unknowns, point = at.task.unknowns, at.point
    ask = at.task.options.accuracy
    accuracy = 0.0 if ask is None else ask()
    linear = _Linearised.at(at.arrow, unknowns, at.task.local, point, accuracy)
    values, weak = weak_combinations(
        linear.factors.matrix,
        np.ones(len(linear.names)),
        linear.names,
        linear.size.shared[linear.chosen],
        least=max(WEAK, accuracy),
    )
    singular = np.zeros(len(unknowns))
    singular[linear.chosen] = values
    return LeastSquaresResult(
        unknowns=unknowns,
        values=point.shared,
        local=point.local,
        cost=at.cost,
        residual_count=at.residual_count,
        parameter_count=int(linear.mask.flat().sum()),
        covariance=linear.covariance,
        local_std=_local_std(linear.factors, linear.inverse, linear.mask, linear.size),
        at_bound=tuple(unknown.name for unknown, one in zip(unknowns, linear.chosen, strict=True) if not one),
        singular_values=np.sort(singular)[::-1],
        weak=weak,
        outcome=outcome,
        message=message,
        iterations=iterations,
        evaluations=evaluations,
    )


def slopes_of_minimum(
    blocks: Sequence[Block],
    causes: Sequence[Floats],
    unknowns: Sequence[Unknown],
    local: Sequence[Sequence[Unknown]],
    values: Floats,
    local_values: Sequence[Floats],
) -> Floats:
    """(p, k) how the shared unknowns at a minimum follow k causes, zero for those held at a bound.

    With J the derivatives by the unknowns, K those by the causes and P the priors' variances, the minimum of
    ``|r + K·c|²`` moves by ``-(JᵀJ + P⁻¹)⁻¹JᵀK`` times c; for the shared ones, with the records' own free.

    Parameters
    ----------
    blocks: residuals and J at the minimum.
    causes: (values, k) K of each record.
    values, local_values: of the minimum.
    """
    count, more = len(unknowns), causes[0].shape[1] if causes else 0
    # K beside J, as further shared columns whose steps are given: in the triangle the records' own unknowns
    # are then eliminated from both alike
    joint = [
        Block(block.residual, np.column_stack([_of_shared(block), columns]), block.local)
        for block, columns in zip(blocks, causes, strict=True)
    ]
    everything = [*unknowns, *(Unknown(f"cause {k}", 0.0) for k in range(more))]
    point = Vector(np.concatenate([values, np.zeros(more)]), tuple(local_values))
    linear = _Linearised.at(
        reduce_blocks(joint, count + more, [len(each) for each in local]), everything, local, point
    )
    free = linear.chosen[:count]
    of_unknowns, of_causes = np.split(linear.factors.matrix, [int(free.sum())], axis=1)
    slopes = np.zeros((count, more))
    inverse = _inverse(of_unknowns)
    inverse[~np.isfinite(inverse)] = 0.0  # nothing determines those: they follow nothing either
    sizes = linear.size.shared
    slopes[free] = -inverse @ of_unknowns.T @ of_causes * sizes[count:] / sizes[:count][free][:, None]
    return slopes


def _of_shared(block: Block) -> Floats:
    return np.empty((block.residual.size, 0)) if block.shared is None else block.shared


@dataclass(frozen=True)
class _Linearised:
    """The problem at a point, in variables of size 1, with the records' own unknowns eliminated.

    Attributes
    ----------
    size: the length of each unknown's column, by which its step is multiplied.
    mask: 1 for an unknown inside its bounds, 0 for one held at one; `chosen` that of the shared ones.
    names: of the chosen ones.
    factors: the triangle of the chosen ones, with their priors.
    accuracy: of the derivatives, as a share.
    """

    size: Vector
    mask: Vector
    chosen: NDArray[np.bool_]
    names: list[str]
    factors: Factors
    accuracy: float

    @classmethod
    def at(
        cls,
        arrow: Arrow,
        unknowns: Sequence[Unknown],
        local: Sequence[Sequence[Unknown]],
        point: Vector,
        accuracy: float = 0.0,
    ) -> _Linearised:
        # each column of length 1, so that singular values compare directions and not units; no damping, and
        # only what lies inside its bounds
        everyone = [*unknowns, *(unknown for record_local in local for unknown in record_local)]
        _, weight = prior_rows(everyone, point.flat())
        scale = np.maximum(arrow.norms().flat(), weight)
        scale[scale == 0.0] = 1.0
        size, mask = point.like(scale), point.like(_free(everyone, point.flat()))
        nothing = point.like(np.zeros(scale.size))
        factors = eliminate(arrow.scaled(size), point.like(weight / scale), nothing, mask, nothing)
        chosen = mask.shared.astype(bool)
        names = [unknown.name for unknown, one in zip(unknowns, chosen, strict=True) if one]
        return cls(size, mask, chosen, names, factors, accuracy)

    @cached_property
    def inverse(self) -> Floats:
        """The covariance of the chosen unknowns, in variables of size 1."""
        return _inverse(self.factors.matrix, self.accuracy)

    @property
    def covariance(self) -> Floats:
        """The inverse of JᵀJ with priors, over the parameters that are not held at a bound; for the shared
        ones with the records' own ones free (their Schur complement, by orthogonal elimination)."""
        result = np.zeros((self.chosen.size, self.chosen.size))
        size = self.size.shared[self.chosen]
        result[np.ix_(self.chosen, self.chosen)] = self.inverse / np.outer(size, size)
        return result


def _free(everyone: Sequence[Unknown], values: Floats) -> Floats:
    """1 where a parameter lies inside its bounds, 0 where it is held at one."""
    inside = [unknown.lower < value < unknown.upper for unknown, value in zip(everyone, values, strict=True)]
    return np.array(inside, dtype=float)


def _inverse(matrix: Floats, accuracy: float = 0.0) -> Floats:
    """``(MᵀM)⁻¹``; infinite on the diagonal for parameters in a combination without any effect.

    Parameters
    ----------
    accuracy: relative error of M, below which an effect is none.
    """
    count = matrix.shape[1]
    if not count:
        return np.empty((0, 0))
    # directions whose singular value is an error have no effect on any residual: what lies in one of them is
    # not determined, and said to be so instead of being given a number
    _, values, directions = np.linalg.svd(matrix, full_matrices=True)
    padded = np.zeros(count)
    padded[: values.size] = values
    determined = padded > max(accuracy, _ROUNDING * max(1, matrix.shape[0])) * (padded.max() or 1.0)
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
