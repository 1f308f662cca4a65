"""Normal matrices of disturbances and fitted unknowns, each record's own unknowns projected off."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.disturbance_columns import DisturbanceColumns
from rigctl.compare.evidence import Normal
from rigctl.compare.free_unknowns import free_unknowns
from rigctl.compare.linearise import own_rows, slopes_at
from rigctl.engine.least_squares.unknown import prior_rows
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]

#: of the largest entry, added to the unknowns' scaled matrix: it may be singular
_RIDGE = 1e-10


@dataclass(frozen=True)
class DisturbanceNormals:
    """B the disturbances' whitened columns, J the fitted unknowns', r the residual.

    Attributes
    ----------
    square: (records, columns, columns) BᵀB.
    cross: (records, columns, unknowns) BᵀJ.
    gradient: (records, columns) Bᵀr.
    unknowns: JᵀJ, Jᵀr and rᵀr over all records, with the unknowns' priors.
    excess: how much larger χ² is than the noise alone would make it.
    """

    square: Floats = field(repr=False)
    cross: Floats = field(repr=False)
    gradient: Floats = field(repr=False)
    unknowns: Normal
    excess: float


def disturbance_normals(fit: FitResult, problem: Problem, columns: DisturbanceColumns) -> DisturbanceNormals:
    """The matrices of the records of `problem`, the fitted ones of `fit`, by what the fit could move.

    Raises
    ------
    RigctlError
        a derivative is not a finite number.
    """
    shared = free_unknowns(fit)
    places = {unknown.name: place for place, unknown in enumerate(fit.problem.shared)}
    local = [fit.local[k] for k in fit.fitted]
    slopes = slopes_at(problem, fit, [unknown.name for unknown in shared], (), local)
    whole, freedom = [], 0
    for k, record in enumerate(problem.records):
        whitener, ok, outputs = problem.whiteners[k], problem.ok[k], fit.outputs[fit.fitted[k]]
        residual = whitener(np.where(ok, np.where(ok, record.values, 0.0) - outputs, 0.0))
        white = whitener(np.concatenate([columns.readings[k], slopes.nuisance[k]], axis=2))
        if not np.isfinite(white).all():
            raise RigctlError(f"record {record.label}: a sensitivity is not a finite number")
        rows = np.column_stack([white, residual])
        matrix = rows.T @ rows
        own, weight, prior = own_rows(problem, k, slopes, local[k], outputs)
        taken = own[: whitener.size].T @ rows
        if weight.size:
            taken[:, -1] -= own[whitener.size :].T @ prior
            matrix[-1, -1] += prior @ prior
        whole.append(matrix - taken.T @ taken)
        freedom += whitener.size + int((weight > 0.0).sum()) - own.shape[1]
    prior, weight = prior_rows(shared, fit.values[[places[unknown.name] for unknown in shared]])
    return _split(np.array(whole), columns.readings[0].shape[2], prior, weight, freedom)


def _split(whole: Floats, count: int, prior: Floats, weight: Floats, freedom: int) -> DisturbanceNormals:
    """The blocks of the records' matrices; unknowns are scaled to columns of length one."""
    total = whole.sum(axis=0)
    matrix = total[count:-1, count:-1] + np.diag(weight**2)
    gradient = total[count:-1, -1] - weight * prior
    lengths = np.sqrt(np.diag(matrix))
    scale = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    matrix = matrix * np.outer(scale, scale) + _RIDGE * np.eye(scale.size)
    gradient = gradient * scale
    square = float(total[-1, -1] + prior @ prior)
    taken = float(gradient @ np.linalg.solve(matrix, gradient)) if scale.size else 0.0
    freedom += int((weight > 0.0).sum()) - scale.size
    return DisturbanceNormals(
        square=whole[:, :count, :count],
        cross=whole[:, :count, count:-1] * scale,
        gradient=whole[:, :count, -1],
        unknowns=Normal(matrix, gradient, square),
        excess=square - taken - freedom,
    )
