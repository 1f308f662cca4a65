"""The distance of two rivals in a record after one of them has been refitted, and the information in a
record.

With Δ the whitened difference of two rivals' predictions, J the derivatives by the second one's common
parameters and L those by the record-level unknowns, scaled to one standard deviation of their priors,

    P = 1 − L·(1 + LᵀL)⁻¹·Lᵀ            residual after the record-level unknowns
    D = ΔᵀPΔ − bᵀ·(I + JᵀPJ)⁻¹·b,       b = JᵀPΔ

with I the information of the data so far about the second one. All terms except the last step are sums over
records, so that the D of any set of records follows from their sums (`Evidence`).

Source: W. G. Hunter, A. M. Reiner, Technometrics 7 (1965) 307, for the difference; profiled over the refitted
parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """One rival's prediction of one record, whitened.

    Attributes
    ----------
    predicted: (rows).
    shared: (rows, p) derivatives by its common parameters, each times its typical size.
    own: (rows, l) by the record-level unknowns, each times the standard deviation of its prior.
    """

    predicted: Floats
    shared: Floats
    own: Floats

    def left(self, columns: Floats) -> Floats:
        """``P·columns``: the part that the record-level unknowns cannot imitate."""
        if not self.own.shape[1]:
            return columns
        inner = np.eye(self.own.shape[1]) + self.own.T @ self.own
        return columns - self.own @ np.linalg.solve(inner, self.own.T @ columns)


@dataclass(frozen=True)
class Evidence:
    """The information in records about k rivals.

    Attributes
    ----------
    squares: (k, k) ``ΔᵀPΔ`` with P of the second rival, the one that is refitted.
    slopes: for each second rival, (k, p) ``JᵀPΔ`` by the first.
    information: for each rival, (p, p) ``JᵀPJ``.
    """

    squares: Floats
    slopes: tuple[Floats, ...]
    information: tuple[Floats, ...]

    @classmethod
    def of(cls, responses: Sequence[Response]) -> Evidence:
        """The evidence of one record, from every rival's response to it."""
        # Δ_ij = f_i − f_j in whitened rows. The record-level unknowns of the rival j, which is refitted, are
        # projected off once for all i, and with them its derivatives: the rest is sums of products, additive
        # over records.
        predicted = np.stack([one.predicted for one in responses], axis=1)
        squares = np.zeros((len(responses), len(responses)))
        slopes, information = [], []
        for j, rival in enumerate(responses):
            differences = predicted - rival.predicted[:, None]
            residuals = rival.left(np.hstack([differences, rival.shared]))
            count = len(responses)
            squares[:, j] = np.einsum("nk,nk->k", differences, residuals[:, :count])
            slopes.append(differences.T @ residuals[:, count:])
            information.append(rival.shared.T @ residuals[:, count:])
        return cls(squares, tuple(slopes), tuple(information))

    @classmethod
    def total(cls, parts: Iterable[Evidence]) -> Evidence:
        """The evidence of several records together."""
        evidence = list(parts)
        return cls(
            np.sum([one.squares for one in evidence], axis=0),
            tuple(np.sum(each, axis=0) for each in zip(*(one.slopes for one in evidence), strict=True)),
            tuple(np.sum(each, axis=0) for each in zip(*(one.information for one in evidence), strict=True)),
        )

    def __add__(self, other: Evidence) -> Evidence:
        return Evidence.total((self, other))

    def scaled(self, factor: float) -> Evidence:
        """The evidence multiplied by a factor; 0 gives that of no record."""
        return Evidence(
            factor * self.squares,
            tuple(factor * one for one in self.slopes),
            tuple(factor * one for one in self.information),
        )

    def distances(self, known: Sequence[Floats]) -> Floats:
        """(k, k) D of the first from the second, which is refitted; `known` is I of each, (p, p)."""
        distances = self.squares.copy()
        for j, (slopes, information) in enumerate(zip(self.slopes, self.information, strict=True)):
            if slopes.shape[1]:
                # D = ΔᵀPΔ − bᵀ(I + JᵀPJ)⁻¹b, b = JᵀPΔ: the only step that is not additive, in p × p matrices.
                solved = np.linalg.solve(known[j] + information, slopes.T)
                distances[:, j] -= np.einsum("kp,pk->k", slopes, solved)
        return np.maximum(distances, 0.0)


@dataclass(frozen=True)
class Refit:
    """How a rival with the information so far absorbs new records: ``S = 1 + A·Aᵀ``.

    A holds the derivatives by all its unknowns there, each times its standard deviation so far: S is the
    covariance of its prediction of the records, in units of the noise.

    Attributes
    ----------
    columns: A, (rows, unknowns).
    """

    columns: Floats

    @classmethod
    def of(cls, responses: Sequence[Response], known: Floats) -> Refit:
        """The refit to new records, which share the common parameters but not the record-level ones."""
        # Columns times the standard deviations so far, so that S = 1 + A·Aᵀ; S⁻¹ by Woodbury in the number of
        # unknowns.
        root = np.linalg.cholesky(np.linalg.inv(known)) if known.size else np.zeros((0, 0))
        shared = np.vstack([one.shared for one in responses]) @ root
        rows = [one.predicted.size for one in responses]
        local = np.zeros((sum(rows), sum(one.own.shape[1] for one in responses)))
        row = column = 0
        for one, count in zip(responses, rows, strict=True):
            local[row : row + count, column : column + one.own.shape[1]] = one.own
            row, column = row + count, column + one.own.shape[1]
        return cls(np.hstack([shared, local]))

    def left(self, differences: Floats) -> Floats:
        """``S⁻¹·Δ``, for (rows) or (rows, k)."""
        inner = np.eye(self.columns.shape[1]) + self.columns.T @ self.columns
        return differences - self.columns @ np.linalg.solve(inner, self.columns.T @ differences)
