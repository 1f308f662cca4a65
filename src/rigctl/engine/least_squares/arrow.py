"""The linear problem of one Gauss-Newton step, whose matrix has the shape of an arrow.

    minimise  sum over records k of |L_k·l_k + G_k·g + r_k|²  +  damping and priors

The steps l_k of the record-level parameters are eliminated record by record, by orthogonal transformations;
the remaining problem is small and dense in the shared step g. Work and memory grow linearly with the number
of records. Unlike normal equations, orthogonal transformations do not square the condition number. Å. Björck,
Numerical Methods for Least Squares Problems (1996), section 6.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.block import Block, check_block, check_count
from rigctl.engine.threads import in_threads

Floats = NDArray[np.float64]


_PIECE = 4096  # number of values reduced at once


@dataclass(frozen=True)
class Vector:
    """A value for every parameter: the shared ones, and those of each record."""

    shared: Floats
    local: tuple[Floats, ...]

    def flat(self) -> Floats:
        """All values in one array, the shared ones first."""
        return np.concatenate([self.shared, *self.local])

    def like(self, flat: Floats) -> Vector:
        """The array `flat`, divided like this vector."""
        end, local = self.shared.size, []
        for record_local in self.local:
            begin, end = end, end + record_local.size
            local.append(flat[begin:end])
        return Vector(flat[: self.shared.size], tuple(local))


@dataclass(frozen=True)
class Arrow:
    """The linearised residuals of all records, each reduced to a small triangle.

    Attributes
    ----------
    triangles: (rows, m_k + p + 1) of each record: columns of its own parameters, of the shared ones, and the
        right-hand side -r. There are at most as many rows as columns.
    local: m_k of each record.
    """

    triangles: tuple[Floats, ...]
    local: tuple[int, ...]
    shared: int

    def scaled(self, size: Vector) -> Arrow:
        """This problem in the variables ``step·size``: every column divided by its size."""
        triangles = tuple(
            triangle / np.concatenate([record_local, size.shared, [1.0]])
            for triangle, record_local in zip(self.triangles, size.local, strict=True)
        )
        return Arrow(triangles, self.local, self.shared)

    def norms(self) -> Vector:
        """The length of each parameter's column: its effect on the residuals."""
        record_local = tuple(
            np.linalg.norm(triangle[:, :m], axis=0)
            for triangle, m in zip(self.triangles, self.local, strict=True)
        )
        squares = np.zeros(self.shared)
        for triangle, m in zip(self.triangles, self.local, strict=True):
            squares += np.square(triangle[:, m:-1]).sum(axis=0)
        return Vector(np.sqrt(squares), record_local)

    def gradient(self) -> Vector:
        """``Jᵀr``: the gradient of the cost, without priors."""
        record_local = tuple(
            -triangle[:, :m].T @ triangle[:, -1]
            for triangle, m in zip(self.triangles, self.local, strict=True)
        )
        shared = np.zeros(self.shared)
        for triangle, m in zip(self.triangles, self.local, strict=True):
            shared -= triangle[:, m:-1].T @ triangle[:, -1]
        return Vector(shared, record_local)

    def change(self, step: Vector) -> float:
        """The change of half the sum of squares by `step` in the linear model."""
        total = 0.0
        for triangle, m, record_local in zip(self.triangles, self.local, step.local, strict=True):
            moved = triangle[:, :m] @ record_local + triangle[:, m:-1] @ step.shared
            total += 0.5 * float(moved @ moved) - float(moved @ triangle[:, -1])
        return total


def reduce_blocks(blocks: Sequence[Block], shared: int, local: Sequence[int]) -> Arrow:
    """Reduce the records' blocks to triangles; those of records without own parameters are combined.

    Raises
    ------
    RigctlError
        derivatives are missing or not finite; the message names the record by its number.
    """
    check_count(blocks, len(local))
    sizes = tuple(local)
    # in threads: a block's derivatives are whitened when they are first used, which is here
    triangles = in_threads(partial(_reduced, blocks, shared, sizes), range(len(blocks)))
    # records without unknowns of their own add up to one triangle: what is left does not grow with their
    # number
    bare = [index for index, m in enumerate(sizes) if m == 0]
    common = np.empty((0, shared + 1))
    for index in bare:
        common = _triangle(np.vstack([common, triangles[index]]))
        triangles[index] = np.empty((0, shared + 1))
    if bare:
        triangles[bare[0]] = common
    return Arrow(tuple(triangles), sizes, shared)


def _reduced(blocks: Sequence[Block], shared: int, local: Sequence[int], index: int) -> Floats:
    """The triangle of one record."""
    block, m = blocks[index], local[index]
    check_block(block, index + 1, shared, m)
    parts = [block.local] if block.local is not None and m else []
    parts += [block.shared] if block.shared is not None and shared else []
    return _triangle(np.column_stack([*parts, -block.residual]))


@dataclass(frozen=True)
class Eliminated:
    """Records with their own parameters eliminated: ``top·l = rhs - coupling·g``, along the first axis.

    `records` are their indices; all of them have the same free and the same held parameters.
    """

    records: tuple[int, ...]
    top: Floats
    coupling: Floats
    rhs: Floats


@dataclass(frozen=True)
class Factors:
    """The arrow in triangular form: `shared` rows (·, p) with right-hand side, and the eliminated records.

    `count` is the number of records; one without free parameters of its own is in no group.
    """

    matrix: Floats
    rhs: Floats
    groups: tuple[Eliminated, ...]
    count: int

    def solve(self) -> Vector:
        """The step; of minimum norm if the data do not determine it."""
        shared = _least(self.matrix, self.rhs)
        record_local = [np.empty(0)] * self.count
        for group in self.groups:
            solved = _least_each(group.top, group.rhs - group.coupling @ shared)
            for index, values in zip(group.records, solved, strict=True):
                record_local[index] = values
        return Vector(shared, tuple(record_local))


def eliminate(arrow: Arrow, weight: Vector, target: Vector, free: Vector, fixed: Vector) -> Factors:
    """Eliminate the record-level parameters, with an additional equation ``weight·step = target`` for each.

    Records with the same free parameters are triangulated in one call, as each is small.

    Parameters
    ----------
    weight, target: of those equations: damping, priors.
    free: 1 for a parameter that is solved for, 0 for one whose step is given.
    fixed: the given steps.
    """
    # records of the same size with the same free unknowns are stacked: one call of the library for all of
    # them
    chosen = free.shared.astype(bool)
    count = int(chosen.sum())
    alike: dict[tuple[int, int, bytes], list[int]] = {}
    for k, (triangle, m) in enumerate(zip(arrow.triangles, arrow.local, strict=True)):
        alike.setdefault((len(triangle), m, free.local[k].astype(bool).tobytes()), []).append(k)
    rows = [np.empty((0, count + 1))]
    groups = []
    for (_, m, _), indices in alike.items():
        triangles = np.stack([arrow.triangles[k] for k in indices])
        record_local = free.local[indices[0]].astype(bool)
        given, weights, targets = (
            np.stack([vector.local[k] for k in indices]) for vector in (fixed, weight, target)
        )
        # what is held moves to the right-hand side with its given step
        rhs = triangles[:, :, -1] - triangles[:, :, m:-1] @ fixed.shared
        rhs -= (triangles[:, :, :m] @ given[:, :, None])[:, :, 0]
        size, first = triangles.shape[1], int(record_local.sum())
        # (records, rows, columns): the own unknowns, the shared ones, the right-hand side; below the data a
        # row for the prior or damping of each own unknown. In the triangle of that, the first rows give the
        # own unknowns once the shared ones are known, and the others are what the record says of the shared
        # ones
        matrix = np.zeros((len(indices), size + m, first + count + 1))
        matrix[:, :size, :first] = triangles[:, :, :m][:, :, record_local]
        matrix[:, :size, first:-1] = triangles[:, :, m:-1][:, :, chosen]
        matrix[:, :size, -1] = rhs
        matrix[:, size:, :first] = (weights[:, :, None] * np.eye(m))[:, :, record_local]
        matrix[:, size:, -1] = targets - weights * given
        if first:
            matrix = np.asarray(np.linalg.qr(matrix, mode="r"))
            top, coupling = matrix[:, :first, :first], matrix[:, :first, first:-1]
            groups.append(Eliminated(tuple(indices), top, coupling, matrix[:, :first, -1]))
        rows.append(matrix[:, first:, first:].reshape(-1, count + 1))
    # all records' rows for the shared unknowns, with their own priors and damping: the small dense problem
    # that is left
    rest = target.shared - weight.shared * fixed.shared
    rows.append(np.column_stack([np.diag(weight.shared)[:, chosen], rest]))
    stacked = _triangle(np.vstack(rows))
    return Factors(stacked[:, :-1], stacked[:, -1], tuple(groups), len(arrow.local))


def _triangle(matrix: Floats) -> Floats:
    """The triangle with the same normal equations; a matrix with few rows is returned unchanged.

    Reduced in pieces, then together: pieces of this size stay below that from which a linear algebra library
    starts threads, which cost far more than the work when the cores are busy.
    """
    rows, columns = matrix.shape
    piece = max(2 * columns, _PIECE // max(columns, 1))
    if rows > piece:
        padded = np.zeros((-(-rows // piece) * piece, columns))
        padded[:rows] = matrix
        pieces = np.asarray(np.linalg.qr(padded.reshape(-1, piece, columns), mode="r"))
        return _triangle(pieces.reshape(-1, columns))
    if rows <= columns:
        return matrix
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def _least(matrix: Floats, rhs: Floats) -> Floats:
    if not matrix.shape[1]:
        return np.empty(0)
    return np.asarray(np.linalg.lstsq(matrix, rhs, rcond=None)[0])


#: least ratio of the smallest to the largest diagonal entry at which a triangle is solved by substitution
_REGULAR = 1e-8


def _least_each(tops: Floats, rhs: Floats) -> Floats:
    """(records, columns) `_least` of each triangle."""
    pivots = np.abs(np.diagonal(tops, axis1=1, axis2=2))
    regular = pivots.min(axis=1) > _REGULAR * pivots.max(axis=1)
    if regular.all():
        return np.asarray(np.linalg.solve(tops, rhs[:, :, None])[:, :, 0])
    return np.array([_least(top, right) for top, right in zip(tops, rhs, strict=True)])
