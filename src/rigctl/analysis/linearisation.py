"""One linearisation of a fitted model, on which every test and verdict is based.

    r = W(y − f(θ̂)),   J = W ∂f/∂θ,   S = W ∂f/∂φ at φ = null

with the record-level unknowns already projected off, priors as further rows, and each record reduced to a
triangle with the same inner products, so that later computations cost the same for long and short records.

It also holds the phase and channel of each residual, and the shared unknowns that can absorb a misfit.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.candidates import Candidate, candidates
from rigctl.engine.least_squares import Unknown
from rigctl.engine.least_squares.unknown import prior_rows
from rigctl.engine.result_cache import cached
from rigctl.engine.threads import in_threads
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.recent import point_of

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Regions:
    """The combinations of phase and channel, over all records.

    Attributes
    ----------
    labels: (phase, channel) of each column.
    conditions: (records, variables) the records' operating points, each variable scaled to −1 … 1.
    variables: names of these variables.
    groups: (records) index of each record's condition.
    """

    labels: tuple[tuple[str, str], ...]
    conditions: Floats
    variables: tuple[str, ...]
    groups: tuple[int, ...]
    _phase: tuple[NDArray[np.intp], ...] = field(repr=False)
    _channels: int = 0

    def of_record(self, k: int, rows: NDArray[np.intp]) -> Floats:
        """(rows, columns) the unit vector of each region: ``EᵀW e`` is the sum of its residuals over √n."""
        region = self._phase[k][rows[:, 0]] * self._channels + rows[:, 1]
        columns = (region[:, None] == np.arange(len(self.labels))[None, :]).astype(float)
        lengths = np.sqrt(columns.sum(axis=0))
        return np.asarray(columns / np.where(lengths > 0.0, lengths, 1.0))

    def plane(self, k: int) -> Floats:
        """(basis) 1, each variable, and the products of two, at a record's condition."""
        point = self.conditions[k]
        products = [point[i] * point[j] for i in range(point.size) for j in range(i + 1, point.size)]
        return np.array([1.0, *point, *products])


def make_regions(problem: Problem) -> Regions:
    """The regions of a problem's records."""
    records, outputs = problem.records, problem.measurements.outputs
    phases = tuple(dict.fromkeys(name for record in records for name in record.phases))
    if len(phases) > _MOST_PHASES:  # a table, each row of which is a phase
        phases = ("all",)
    index = {name: k for k, name in enumerate(phases)}
    phase_of = tuple(
        np.array([index.get(name, 0) for name in record.phases], dtype=np.intp)[record.phase]
        for record in records
    )
    names, points = _conditions(problem)
    return Regions(
        labels=tuple((phase, channel) for phase in phases for channel in outputs),
        conditions=points,
        variables=names,
        groups=tuple(record.group for record in records),
        _phase=phase_of,
        _channels=len(outputs),
    )


#: an unknown closer to a bound than this share of the distance between its bounds counts as held there
_AT_BOUND = 1e-6
#: least outward push, in sigmas, for it to count as held
_PUSHED = 3.0
_MOST_PHASES = 24
_MOST_VARIABLES = 3


def _conditions(problem: Problem) -> tuple[tuple[str, ...], Floats]:
    records = problem.records
    names = [
        name for name in problem.measurements.variables if all(name in record.condition for record in records)
    ][:_MOST_VARIABLES]
    values = np.array([[record.condition[name] for name in names] for record in records])
    values = values.reshape(len(records), len(names))
    if not len(names):
        return (), values
    low, high = values.min(axis=0), values.max(axis=0)
    half = np.where(high > low, 0.5 * (high - low), 1.0)
    return tuple(names), (values - 0.5 * (high + low)) / half


def quiet_columns(problem: Problem, k: int, outputs: Floats) -> Floats | None:
    """(n, channels, columns) one column for each phase in which a coarsely quantised channel is constant.

    In such a phase the quantisation error does not average out: all readings share a part of it, with the
    standard deviation `ChannelNoise.bias`.
    """
    record, columns = problem.records[k], []
    for c, channel in enumerate(problem.noise.channels):
        if channel.bias <= 0.0 or channel.step <= 0.0:
            continue
        for phase in np.unique(record.phase):
            inside = record.phase == phase
            if inside.sum() > 2 and float(np.ptp(outputs[inside, c])) < channel.step:
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
        moved = [
            (self.starts[index] + k, name)
            for index in fitted
            for k, name in enumerate(self.candidates[index].columns)
            if name not in self.fit.at_bound
        ]
        bent = self.shapes if tolerance > 0.0 else ()
        shapes = range(self.full_lengths.size - len(bent), self.full_lengths.size)
        joined = [*(column for column, _ in moved), *shapes]
        scale = np.array([*np.ones(len(moved)), *np.full(len(bent), tolerance)])
        columns = [
            column
            for index in remaining
            for column in range(*self.columns_of(index).indices(self.full_lengths.size))
        ]
        if shaped:
            columns += range(self.full_lengths.size - len(self.shapes), self.full_lengths.size)
        chosen = tuple(self.candidates[index] for index in remaining)
        starts = np.cumsum([0, *(len(one.columns) for one in chosen)])[:-1]
        weight, residual = self.prior
        priors = np.diag([*np.zeros(len(moved)), *np.ones(len(shapes))])
        more = len(joined)
        joint = np.pad(weight, (0, more))
        joint[weight.shape[0] :, weight.shape[1] :] = priors
        return replace(
            self,
            candidates=chosen,
            starts=tuple(int(start) for start in starts),
            nuisances=(*self.nuisances, *(name for _, name in moved), *bent),
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
    bends = shapes[0].shape[2] if shapes else 0
    triangles, squares = [], np.zeros(sum(len(one.columns) for one in chosen) + bends)
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
        if bends:
            for index, k in enumerate(part):
                slopes.signatures[index] = np.concatenate([slopes.signatures[index], shapes[k]], axis=2)
        record_points = [(index, local[k], fit.outputs[fit.fitted[k]]) for index, k in enumerate(part)]
        for triangle, more in in_threads(partial(_record, some, regions, part[0], slopes), record_points):
            squares += more
            triangles.append(triangle)
    return _Triangles(tuple(triangles), squares)


@dataclass(frozen=True)
class Slopes:
    """(n, channels, columns) for each record: nuisances, candidates' columns, and own unknowns by name."""

    nuisance: list[Floats]
    signatures: list[Floats]
    record_local: list[Mapping[str, Floats]]

    def of(self, indices: Sequence[int]) -> Slopes:
        """The slopes of the records at `indices`, in new lists."""
        return Slopes(
            nuisance=[self.nuisance[k] for k in indices],
            signatures=[self.signatures[k] for k in indices],
            record_local=[self.record_local[k] for k in indices],
        )


class KnownSlopes:
    """The derivatives of one linearisation, for another at the same point with further columns.

    They are large: kept only if those of all records fit into memory together, and until used once.
    """

    def __init__(self) -> None:
        self._found: tuple[object, Slopes] | None = None

    def keep(self, point: object, slopes: Slopes) -> None:
        """Keep what was computed at a point, by the same unknowns and candidates."""
        self._found = point, slopes

    def take(self, point: object) -> Slopes | None:
        """Return and forget the slopes kept for `point`; None if they are of another point."""
        if self._found is None or self._found[0] != point:
            return None
        (_, slopes), self._found = self._found, None
        return slopes


def slopes_at(
    problem: Problem,
    fit: FitResult,
    free: Sequence[str],
    chosen: Sequence[Candidate],
    local: Sequence[Floats],
) -> Slopes:
    """Derivatives of the records of `problem` at `fit`, by the unknowns `free`, the candidates and their own.

    Simulates once with every column, and once more for each further choice of shapes and each finite size.
    """
    base = base_at(problem, fit)
    first = _shaped_first(fit, chosen)
    at = problem.with_shared((), _with_shapes(problem, base, [chosen[index] for index in first]))
    plain = [
        name
        for index, one in enumerate(chosen)
        if index in first or not (one.shapes or one.secants)
        for name in one.columns
    ]
    columns = tuple(dict.fromkeys([*free, *problem.local_names, *plain]))
    simulated = at.simulate(np.empty(0), local, columns, initial=True).require()
    index = {name: k for k, name in enumerate(simulated.columns)}
    every = [np.take(array, problem.channels, axis=1) for array in simulated.sensitivities]
    further = {k: one for k, one in enumerate(chosen) if one.shapes and k not in first}
    elsewhere = _shaped(at, base, further, local) | _sized(at, base, chosen, local, simulated.outputs)
    starts = np.cumsum([0, *(len(one.columns) for one in chosen)])
    direct = [k for k in range(len(chosen)) if k not in elsewhere]
    into = [column for k in direct for column in range(starts[k], starts[k + 1])]
    out_of = [index[name] for k in direct for name in chosen[k].columns]
    signatures = [np.empty((*array.shape[:2], starts[-1])) for array in every]
    for k, (signature, array) in enumerate(zip(signatures, every, strict=True)):
        signature[:, :, into] = array[:, :, out_of]
        for position, arrays in elsewhere.items():
            signature[:, :, starts[position] : starts[position + 1]] = arrays[k]
    return Slopes(
        nuisance=[array[:, :, [index[name] for name in free]] for array in every],
        signatures=signatures,
        record_local=[{name: array[:, :, k] for name, k in index.items()} for array in every],
    )


def base_at(problem: Problem, fit: FitResult) -> Floats:
    """The superset's parameters at the fitted point; those that the fitted system lacks are at their null."""
    indices = {name: k for k, name in enumerate(problem.compiled.system.parameter_names)}
    base = problem.base.copy()
    for name, value in zip(fit.problem.compiled.system.parameter_names, fit.problem.base, strict=True):
        if name in indices:
            base[indices[name]] = value
    for unknown, value in zip(fit.problem.shared, fit.values, strict=True):
        base[indices[unknown.name]] = value
    return base


def _shaped_first(fit: FitResult, chosen: Sequence[Candidate]) -> frozenset[int]:
    """The indices of candidates whose shapes the simulation with every column can have.

    At its null an effect acts on nothing, whatever its shape: of each that the fit does not have, and that is
    not looked at in its usual shape, the first.
    """
    present = set(fit.problem.model.effects) | {one.name for one in chosen if not one.shapes or one.secants}
    indices = []
    for index, one in enumerate(chosen):
        if one.name not in present:
            present.add(one.name)
            indices.append(index)
    return frozenset(indices)


def _with_shapes(problem: Problem, base: Floats, together: Collection[Candidate]) -> Floats:
    """The parameters `base` with the shapes of some candidates."""
    names = problem.compiled.system.parameter_names
    moved = base.copy()
    for one in together:
        for name, value in one.shapes.items():
            moved[names.index(name)] = value
    return moved


def _shaped(
    problem: Problem, base: Floats, further: Mapping[int, Candidate], local: Sequence[Floats]
) -> dict[int, list[Floats]]:
    """Columns at other shapes; candidates of different effects share a simulation."""
    rounds: list[dict[int, Candidate]] = []
    for index, one in further.items():
        home = next((r for r in rounds if all(other.name != one.name for other in r.values())), None)
        if home is None:
            home = {}
            rounds.append(home)
        home[index] = one
    result: dict[int, list[Floats]] = {}
    for together in rounds:
        moved = _with_shapes(problem, base, together.values())
        columns = [name for one in together.values() for name in one.columns]
        simulated = problem.with_shared((), moved).simulate(np.empty(0), local, columns).require()
        for index, one in together.items():
            at = [columns.index(name) for name in one.columns]
            result[index] = [np.take(s, problem.channels, axis=1)[:, :, at] for s in simulated.sensitivities]
    return result


def _sized(
    problem: Problem,
    base: Floats,
    chosen: Sequence[Candidate],
    local: Sequence[Floats],
    outputs: Sequence[Floats],
) -> dict[int, list[Floats]]:
    """For the candidates evaluated at a size a: the secant ``(f(a) − f(φ))/(a − φ)`` instead of the slope.

    `outputs` are the outputs f(φ) at the point itself, where the effect is off or has its fitted size.
    """
    names = problem.compiled.system.parameter_names
    result: dict[int, list[Floats]] = {}
    for index, one in enumerate(chosen):
        if not one.secants:
            continue
        moved = base.copy()
        for name, value in one.secants.items():
            moved[names.index(name)] = value
        rest = [name for name in one.columns if name not in one.secants]
        simulated = problem.with_shared((), moved).simulate(np.empty(0), local, rest).require()
        steps = {name: value - base[names.index(name)] for name, value in one.secants.items()}
        result[index] = []
        for k, output in enumerate(outputs):
            columns = {name: simulated.sensitivities[k][:, :, i] for i, name in enumerate(rest)}
            for name, step in steps.items():
                columns[name] = (simulated.outputs[k] - output) / step if step else np.zeros_like(output)
            readings = [np.take(columns[name], problem.channels, axis=1) for name in one.columns]
            result[index].append(np.stack(readings, axis=2))
    return result


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
    white = whitener(np.concatenate([slopes.nuisance[k], slopes.signatures[k]], axis=2))
    if not np.isfinite(white).all():
        raise RigctlError(f"record {record.label}: a sensitivity is not a finite number")
    p = slopes.nuisance[k].shape[2]
    squares = np.square(white[:, p:]).sum(axis=0)
    rows = np.column_stack([white, regions.of_record(first + k, whitener.rows), residual])
    local_basis, weight, prior_residual = record_local_rows(problem, k, slopes, local, outputs)
    count = whitener.size + int((weight > 0.0).sum())
    if weight.size:
        prior_part = np.zeros((weight.size, rows.shape[1]))
        prior_part[:, -1] = -prior_residual
        rows = np.vstack([rows, prior_part])
        rows = rows - local_basis @ (local_basis.T @ rows)
        count -= local_basis.shape[1]
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
