"""The linear problem of one Gauss-Newton step, whose matrix has the shape of an arrow.

    minimise  sum over records k of |L_k·l_k + G_k·g + r_k|²  +  damping and priors

The records' own steps l_k are eliminated record by record, by orthogonal transformations; what is left is
small and dense in the shared step g. Work and memory grow linearly with the records. Orthogonal rather than
normal equations: the condition number is not squared. Å. Björck, Numerical Methods for Least Squares
Problems (1996), section 6.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares.block import Block
from rigctl.engine.least_squares.loss import Loss, weights

Floats = NDArray[np.float64]


_PIECE = 4096  # numbers that are reduced at once


@dataclass(frozen=True)
class Vector:
    """A value for every parameter: the shared ones, and each record's own."""

    shared: Floats
    local: tuple[Floats, ...]

    def flat(self) -> Floats:
        """All of them in one array, the shared ones first."""
        return np.concatenate([self.shared, *self.local])

    def like(self, flat: Floats) -> Vector:
        """`flat` divided as this one is."""
        ends = np.cumsum([self.shared.size, *(local.size for local in self.local)])
        pieces = np.split(flat, ends[:-1])
        return Vector(pieces[0], tuple(pieces[1:]))


@dataclass(frozen=True)
class Arrow:
    """The linearised residuals of all records, each reduced to a small triangle.

    Attributes
    ----------
    triangles: (rows, m_k + p + 1) of each record: columns of its own parameters, of the shared ones, and the
        right-hand side -r. Rows at most as many as columns.
    local: m_k of each record.
    """

    triangles: tuple[Floats, ...]
    local: tuple[int, ...]
    shared: int

    def scaled(self, size: Vector) -> Arrow:
        """The same problem in the variables ``step·size``: every column divided by its size."""
        triangles = tuple(
            triangle / np.concatenate([own, size.shared, [1.0]])
            for triangle, own in zip(self.triangles, size.local, strict=True)
        )
        return Arrow(triangles, self.local, self.shared)

    def norms(self) -> Vector:
        """The length of each parameter's column: how strongly it acts on the residuals."""
        own = tuple(
            np.linalg.norm(triangle[:, :m], axis=0)
            for triangle, m in zip(self.triangles, self.local, strict=True)
        )
        squares = np.zeros(self.shared)
        for triangle, m in zip(self.triangles, self.local, strict=True):
            squares += np.square(triangle[:, m:-1]).sum(axis=0)
        return Vector(np.sqrt(squares), own)

    def gradient(self) -> Vector:
        """``Jᵀr``: the gradient of the cost, without priors."""
        own = tuple(
            -triangle[:, :m].T @ triangle[:, -1]
            for triangle, m in zip(self.triangles, self.local, strict=True)
        )
        shared = np.zeros(self.shared)
        for triangle, m in zip(self.triangles, self.local, strict=True):
            shared -= triangle[:, m:-1].T @ triangle[:, -1]
        return Vector(shared, own)

    def change(self, step: Vector) -> float:
        """The change of half the sum of squares that the linear model expects from `step`."""
        total = 0.0
        for triangle, m, own in zip(self.triangles, self.local, step.local, strict=True):
            moved = triangle[:, :m] @ own + triangle[:, m:-1] @ step.shared
            total += 0.5 * float(moved @ moved) - float(moved @ triangle[:, -1])
        return total


def reduce_blocks(blocks: Sequence[Block], loss: Loss, shared: int, local: Sequence[int]) -> Arrow:
    """Reduce the records' blocks to triangles; records without parameters of their own become one."""
    triangles, sizes, common = [], [], np.empty((0, shared + 1))
    for block, m in zip(blocks, local, strict=True):
        parts = [block.local] if block.local is not None and m else []
        parts += [block.shared] if block.shared is not None and shared else []
        factors = weights(loss, block.residual)
        matrix = np.column_stack([*parts, -block.residual])
        if factors is not None:
            matrix *= factors[:, None]
        triangle = _triangle(matrix)
        if m:
            triangles.append(triangle)
            sizes.append(m)
        else:
            common = _triangle(np.vstack([common, triangle]))
            triangles.append(np.empty((0, shared + 1)))
            sizes.append(0)
    bare = [place for place, m in enumerate(sizes) if m == 0]
    if bare:
        triangles[bare[0]] = common
    return Arrow(tuple(triangles), tuple(sizes), shared)


@dataclass(frozen=True)
class Eliminated:
    """One record with its own parameters solved for: ``top·l = rhs - coupling·g``."""

    top: Floats
    coupling: Floats
    rhs: Floats


@dataclass(frozen=True)
class Factors:
    """The arrow in triangular form: `shared` rows (·, p) with right-hand side, and the eliminated records."""

    matrix: Floats
    rhs: Floats
    records: tuple[Eliminated, ...]

    def solve(self) -> Vector:
        """The step; where the data say nothing, the shortest one."""
        shared = _least(self.matrix, self.rhs)
        own = tuple(_least(one.top, one.rhs - one.coupling @ shared) for one in self.records)
        return Vector(shared, own)


def eliminate(arrow: Arrow, weight: Vector, target: Vector, free: Vector, fixed: Vector) -> Factors:
    """Eliminate the records' own parameters, with one more equation ``weight·step = target`` for each.

    Parameters
    ----------
    weight, target: those equations: damping, priors.
    free: 1 for a parameter that is solved for, 0 for one whose step is given.
    fixed: the given steps.
    """
    chosen = free.shared.astype(bool)
    rows = [np.empty((0, int(chosen.sum())))]
    right = [np.empty(0)]
    records = []
    for k, (triangle, m) in enumerate(zip(arrow.triangles, arrow.local, strict=True)):
        rhs = triangle[:, -1] - triangle[:, m:-1] @ fixed.shared
        shared = triangle[:, m:-1][:, chosen]
        if not m:
            rows.append(shared)
            right.append(rhs)
            records.append(Eliminated(np.empty((0, 0)), np.empty((0, shared.shape[1])), np.empty(0)))
            continue
        own = free.local[k].astype(bool)
        rhs = rhs - triangle[:, :m] @ fixed.local[k]
        count = int(own.sum())
        extra = np.diag(weight.local[k])[:, own]
        left = np.vstack([triangle[:, :m][:, own], extra])
        coupled = np.vstack([shared, np.zeros((m, shared.shape[1]))])
        rhs = np.concatenate([rhs, target.local[k] - weight.local[k] * fixed.local[k]])
        q, top = np.linalg.qr(left, mode="complete")
        coupled, rhs = q.T @ coupled, q.T @ rhs
        records.append(Eliminated(top[:count], coupled[:count], rhs[:count]))
        rows.append(coupled[count:])
        right.append(rhs[count:])
    rows.append(np.diag(weight.shared)[:, chosen])
    right.append(target.shared - weight.shared * fixed.shared)
    stacked = _triangle(np.column_stack([np.vstack(rows), np.concatenate(right)]))
    return Factors(stacked[:, :-1], stacked[:, -1], tuple(records))


def _triangle(matrix: Floats) -> Floats:
    """The triangle with the same normal equations; a matrix that is short already stays as it is.

    Reduced in pieces, then together: pieces this small stay below the size from which a linear algebra
    library starts threads, which cost far more than the work when the cores are busy.
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
