"""One linearisation of a fitted model, on which every test and verdict is based.

    r = W(y − f(θ̂)),   J = W ∂f/∂θ,   S = W ∂f/∂φ at φ = null

with the record-level unknowns already projected off, priors as further rows, and each record reduced to a
triangle with the same inner products, so that later computations cost the same for long and short records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.candidates import Candidate, candidates
from rigctl.analysis.linear.regions import Regions, make_regions
from rigctl.analysis.linear.slopes import KnownSlopes, Slopes, base_at, slopes_at
from rigctl.engine.least_squares import Unknown
from rigctl.engine.least_squares.unknown import prior_rows
from rigctl.engine.result_cache import cached
from rigctl.engine.threads import in_threads
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.recent import point_of

Floats = NDArray[np.float64]

#: an unknown closer to a bound than this share of the distance between its bounds counts as held there
_AT_BOUND = 1e-6
#: least outward push, in sigmas, for it to count as held
_PUSHED = 3.0


def quiet_columns(problem: Problem, k: int, outputs: Floats) -> Floats | None:
    """(n, channels, columns) one column for each phase in which a coarsely quantised channel is constant.

    In such a phase the quantisation error does not average out: all readings share a part of it, with the
    standard deviation `ChannelNoise.bias`.
    """
    record, columns = problem.records[k], []
    for c, channel in enumerate(problem.noise.channels):
        if channel.bias <= 0.0 or channel.step <= 0.0:
            continue
        for inside in record.samples_of_phases:
            if inside.size > 2 and float(np.ptp(outputs[inside, c])) < channel.step:
                column = np.zeros((record.times.size, outputs.shape[1]))
                column[inside, c] = channel.bias
                columns.append(column)
    return np.stack(columns, axis=2) if columns else None


def free_unknowns(fit: FitResult) -> list[Unknown]:
    """The shared unknowns that the fit could still move, i.e. that it did not leave at a bound.

    A model that was evaluated without a fit has none.
    """
    if fit.solution is None:
        return []
    return [unknown for unknown in fit.problem.shared if unknown.name not in fit.at_bound]


@dataclass(frozen=True)
class RecordTriangle:
    """One record: rows that keep every inner product of (J, S, E, r) after projection.

    `count` is the number of degrees of freedom left: readings and priors less the record's own unknowns.
    """

    nuisance: Floats
    signatures: Floats
    regions: Floats
    residual: Floats
    count: int


@dataclass(frozen=True)
class Linearisation:
    """A fitted model, linearised with all its candidates.

    Attributes
    ----------
    fit: the fit at which it is linearised.
    candidates: the effects that were tried, each at each of its shapes.
    starts: for each candidate, the index of its first column of S.
    nuisances: names of J's columns: the shared unknowns that the fit could move.
    regions: the phase and channel of each column of E.
    records: the triangles of the fitted records, in order.
    full_lengths: (S columns) lengths of the whitened columns before any projection.
    prior: rows (J, r) of the shared unknowns' priors.
    shapes: names of S's last columns, which belong to no candidate: the discrepancies of effects' laws.
    """

    fit: FitResult = field(repr=False)
    candidates: tuple[Candidate, ...] = field(repr=False)
    starts: tuple[int, ...] = field(repr=False)
    nuisances: tuple[str, ...]
    regions: Regions = field(repr=False)
    records: tuple[RecordTriangle, ...] = field(repr=False)
    full_lengths: Floats = field(repr=False)
    prior: tuple[Floats, Floats] = field(repr=False)
    shapes: tuple[str, ...] = ()

    def columns_of(self, index: int) -> slice:
        """The columns of S that belong to a candidate."""
        return slice(self.starts[index], self.starts[index] + len(self.candidates[index].columns))

    def rearranged(
        self, fitted: Sequence[int], remaining: Sequence[int], tolerance: float = 0.0, *, shaped: bool = False
    ) -> Linearisation:
        """The same point with the candidates at `fitted` among the nuisances, and of the rest those at
        `remaining`.

        A parameter that the fit left at its bound is no nuisance. Shapes become nuisances with a normal prior
        of standard deviation `tolerance`; at 0 they are left out, or kept in S with `shaped`.
        """
        # 1. Columns that leave S: those of the members, if the fit could move them, and the discrepancies of
        #    the laws.
        moved = [
            (self.starts[index] + k, name)
            for index in fitted
            for k, name in enumerate(self.candidates[index].columns)
            if name not in self.fit.at_bound
        ]
        discrepancies = self.shapes if tolerance > 0.0 else ()
        shapes = range(self.full_lengths.size - len(discrepancies), self.full_lengths.size)
        joined = [*(column for column, _ in moved), *shapes]
        scale = np.array([*np.ones(len(moved)), *np.full(len(discrepancies), tolerance)])
        # 2. Columns that stay in S: those of the remaining candidates.
        columns = [
            column
            for index in remaining
            for column in range(*self.columns_of(index).indices(self.full_lengths.size))
        ]
        if shaped:
            columns += range(self.full_lengths.size - len(self.shapes), self.full_lengths.size)
        chosen = tuple(self.candidates[index] for index in remaining)
        starts = np.cumsum([0, *(len(one.columns) for one in chosen)])[:-1]
        # 3. Priors: none for an effect's parameters, which are free; a unit one for each discrepancy, whose
        #    column was multiplied by its standard deviation instead.
        weight, residual = self.prior
        priors = np.diag([*np.zeros(len(moved)), *np.ones(len(shapes))])
        more = len(joined)
        joint = np.pad(weight, (0, more))
        joint[weight.shape[0] :, weight.shape[1] :] = priors
        return replace(
            self,
            candidates=chosen,
            starts=tuple(int(start) for start in starts),
            nuisances=(*self.nuisances, *(name for _, name in moved), *discrepancies),
            records=tuple(
                replace(
                    one,
                    nuisance=np.hstack([one.nuisance, one.signatures[:, joined] * scale]),
                    signatures=one.signatures[:, columns],
                )
                for one in self.records
            ),
            full_lengths=self.full_lengths[columns],
            prior=(joint, np.pad(residual, (0, more))),
            shapes=self.shapes if shaped else (),
        )


def linearise(
    fit: FitResult,
    problem: Problem,
    tried: Sequence[Candidate] | None = None,
    shapes: tuple[Sequence[str], Sequence[Floats]] = ((), ()),
    free: Sequence[Unknown] | None = None,
    known: KnownSlopes | None = None,
) -> Linearisation:
    """Linearise `fit` on its fitted records; `problem` has the same data and the whole library at its null.

    `shapes` are names and (n, channels, columns) for each fitted record: further columns, with a prior.
    `free` are those of the fit's shared unknowns that become nuisances; by default all that it could
    still move. `known` are derivatives from another linearisation at the same point, or receives them.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    chosen = tuple(candidates(fit.problem.model) if tried is None else tried)
    free = free_unknowns(fit) if free is None else list(free)
    indices = {unknown.name: k for k, unknown in enumerate(fit.problem.shared)}
    inner = problem.only(fit.fitted)
    names = [unknown.name for unknown in free]
    regions = make_regions(inner)
    local, outputs = [fit.local[k] for k in fit.fitted], [fit.outputs[k] for k in fit.fitted]
    tried_at = [(one.columns, one.shapes, one.secants) for one in chosen]
    triangles = cached(
        "linearisation",
        (inner.content, base_at(inner, fit), local, outputs, names, tried_at, regions, shapes),
        _Triangles,
        lambda: _triangles(inner, fit, names, chosen, regions, shapes[1], known),
    )
    residual, weight = prior_rows(free, fit.values[[indices[unknown.name] for unknown in free]])
    starts = np.cumsum([0, *(len(one.columns) for one in chosen)])[:-1]
    return Linearisation(
        fit=fit,
        candidates=chosen,
        starts=tuple(int(start) for start in starts),
        nuisances=tuple(unknown.name for unknown in free),
        regions=regions,
        records=triangles.records,
        full_lengths=np.sqrt(triangles.squares),
        prior=(np.diag(weight), -residual),
        shapes=tuple(shapes[0]),
    )


@dataclass(frozen=True)
class _Triangles:
    """The part of a linearisation that is kept between commands; `squares` of the columns' lengths."""

    records: tuple[RecordTriangle, ...]
    squares: Floats


def _triangles(
    inner: Problem,
    fit: FitResult,
    names: Sequence[str],
    chosen: Sequence[Candidate],
    regions: Regions,
    shapes: Sequence[Floats],
    known: KnownSlopes | None,
) -> _Triangles:
    local = [fit.local[k] for k in fit.fitted]
    shape_count = shapes[0].shape[2] if shapes else 0
    triangles, squares = [], np.zeros(sum(len(one.columns) for one in chosen) + shape_count)
    parts = inner.parts(len(names) + len(inner.local_names) + len(inner.initial_names) + squares.size)
    tried_at = [(one.columns, one.shapes, one.secants) for one in chosen]
    point = point_of(base_at(inner, fit), local), tuple(names), tried_at
    stored = None if known is None else known.take(point)
    for part in parts:
        some = inner.only(part)
        if stored is None:
            slopes = slopes_at(some, fit, names, chosen, [local[k] for k in part])
        else:
            slopes = stored.of(part)
        if known is not None and stored is None and len(parts) == 1:
            known.keep(point, slopes.of(part))
        if shape_count:
            for index, k in enumerate(part):
                slopes.signatures[index] = np.concatenate([slopes.signatures[index], shapes[k]], axis=2)
        record_points = [(index, local[k], fit.outputs[fit.fitted[k]]) for index, k in enumerate(part)]
        for triangle, more in in_threads(partial(_record, some, regions, part[0], slopes), record_points):
            squares += more
            triangles.append(triangle)
    return _Triangles(tuple(triangles), squares)


def _record(
    problem: Problem, regions: Regions, first: int, slopes: Slopes, record_point: tuple[int, Floats, Floats]
) -> tuple[RecordTriangle, Floats]:
    """Whiten a record, project its own unknowns off, and reduce the rest to a triangle.

    `problem` starts with the record that has index `first` in `regions`; `record_point` holds the record's
    index in `problem`, its own unknowns and its outputs.
    """
    k, local, outputs = record_point
    whitener, record, ok = problem.whiteners[k], problem.records[k], problem.ok[k]
    measured = np.where(ok, record.values, 0.0)
    residual = whitener(np.where(ok, measured - outputs, 0.0))
    # W·[J S]: from here on every row has unit variance for a right model, and rows are independent. Columns
    # are in σ per SI unit of their parameter.
    white = whitener(np.concatenate([slopes.nuisance[k], slopes.signatures[k]], axis=2))
    if not np.isfinite(white).all():
        raise RigctlError(f"record {record.label}: a sensitivity is not a finite number")
    p = slopes.nuisance[k].shape[2]
    squares = np.square(white[:, p:]).sum(axis=0)
    rows = np.column_stack([white, regions.of_record(first + k, whitener.rows), residual])
    # The record's own unknowns, with rows for their priors: [W·L; diag(1/σ_prior)]. They are projected off
    # here, record by record, since they would make the joint matrix as wide as there are records.
    local_basis, weight, prior_residual = record_local_rows(problem, k, slopes, local, outputs)
    count = whitener.size + int((weight > 0.0).sum())
    if weight.size:
        prior_part = np.zeros((weight.size, rows.shape[1]))
        prior_part[:, -1] = -prior_residual
        rows = np.vstack([rows, prior_part])
        rows = rows - local_basis @ (local_basis.T @ rows)
        count -= local_basis.shape[1]
    # R of the QR decomposition of [J S E r] has the same inner products with as many rows as there are
    # columns. All tests use inner products only, so that a record of a million samples now costs the same as
    # a short one.
    triangle: Floats = np.asarray(np.linalg.qr(rows, mode="r")) if rows.shape[0] > rows.shape[1] else rows
    e = p + slopes.signatures[k].shape[2]
    return (
        RecordTriangle(triangle[:, :p], triangle[:, p:e], triangle[:, e:-1], triangle[:, -1], count),
        squares,
    )


def record_local_rows(
    problem: Problem, k: int, slopes: Slopes, local: Floats, outputs: Floats
) -> tuple[Floats, Floats, Floats]:
    """The directions of a record's own unknowns in its whitened rows, followed by the rows of their priors.

    Unknowns held by a bound (see `_held`) are left out: what they contribute is given by the fit.

    Returns
    -------
    (rows + unknowns, directions) orthonormal; (unknowns) weights of the priors, 0 if there is none; and
    the priors' residuals.
    """
    whitener = problem.whiteners[k]
    local_columns = [slopes.record_local[k][one.name] for one in problem.local[k]]
    basis = [whitener(np.stack(local_columns, axis=2))] if local_columns else []
    residual, weight = prior_rows([one.unknown for one in problem.local[k]], local)
    held = (
        _held(problem, k, local, outputs, basis[0], -weight * residual)
        if local_columns
        else np.zeros(0, bool)
    )
    quiet = quiet_columns(problem, k, outputs)
    if quiet is not None:
        basis.append(whitener(quiet))
        weight = np.concatenate([weight, np.ones(quiet.shape[2])])
        residual = np.concatenate([residual, np.zeros(quiet.shape[2])])
        held = np.concatenate([held, np.zeros(quiet.shape[2], bool)])
    if not weight.size:
        return np.empty((whitener.size, 0)), weight, residual
    columns = np.vstack([np.concatenate(basis, axis=1), np.diag(weight)])
    return _range(columns[:, ~held]), weight, residual


def _held(
    problem: Problem, k: int, local: Floats, outputs: Floats, columns: Floats, pull: Floats
) -> NDArray[np.bool_]:
    """(unknowns) which of a record's own are at a bound and would leave it significantly.

    At the end of a fit ``cᵀr``, with the prior's pull, is zero for a free unknown and points outwards for one
    that is held; ``(cᵀr/‖c‖)²`` is the possible reduction of χ². If that is small it may be chance, and the
    unknown counts as free: no effect is to be named for what it can do within its bounds.
    """
    unknowns = [one.unknown for one in problem.local[k]]
    lower, upper = (np.array([getattr(one, side) for one in unknowns]) for side in ("lower", "upper"))
    near = _AT_BOUND * np.where(np.isfinite(upper - lower), upper - lower, 0.0)
    low, high = local <= lower + near, local >= upper - near
    if not (low | high).any():
        return np.zeros(len(unknowns), dtype=bool)
    ok, record = problem.ok[k], problem.records[k]
    residual = problem.whiteners[k](np.where(ok, np.where(ok, record.values, 0.0) - outputs, 0.0))
    lengths = np.linalg.norm(columns, axis=0)
    push = (residual @ columns + pull) / np.where(lengths > 0.0, lengths, 1.0)
    return np.asarray((high & (push > _PUSHED)) | (low & (push < -_PUSHED)))


def _range(matrix: Floats) -> Floats:
    """Orthonormal columns that span the columns of `matrix`, after scaling each to unit length."""
    lengths = np.linalg.norm(matrix, axis=0)
    scaled = matrix[:, lengths > 0.0] / lengths[lengths > 0.0]
    if not scaled.shape[1]:
        return np.empty((matrix.shape[0], 0))
    left, values, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(left[:, values > 1e-10 * values[0]])
