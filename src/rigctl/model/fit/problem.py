"""A model and its measurements as a least-squares problem in whitened residuals.

In: a `Model`, `Measurements` and a `NoiseModel` (`make_problem`). Out: a frozen `Problem`, whose `evaluate`
is what `rigctl.engine.least_squares` minimises: it simulates every record with its sensitivities, reads the
outputs as the sensors and clocks would, subtracts the measured values, and whitens. Fits, tests and searches
share it: they ask for other unknowns, other records or the equations of the whole library by `with_shared`,
`only` and `rebuilt`, each of which returns a new problem. What was evaluated last is kept (`recent`), as a
fit's last point is the first one of the tests.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import Effect, qualified
from rigctl.effects.record_level import RECORD, RecordLevel, record_level
from rigctl.engine.compile import CompiledSystem, Progress, compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.least_squares import Block, Refused, Unknown
from rigctl.engine.simulate import simulate
from rigctl.engine.splines import NO_SPLINES, SplineColumns
from rigctl.engine.system import System
from rigctl.engine.tolerance import TIGHT
from rigctl.engine.trajectories import Trajectories
from rigctl.model.build import build_system, superset
from rigctl.model.fit.clocks import STEP, ReadTimes, as_dated, moved_ramps, read_times
from rigctl.model.fit.readings import as_read
from rigctl.model.fit.recent import ROOM, Evaluated, Recent, point_of
from rigctl.model.fit.settings import level_of_rows, repeatability
from rigctl.model.fit.slopes import simulate_soundly
from rigctl.model.fit.switching import (
    LOGGER_DELAYS,
    logger_delay_unknowns,
    moved_times,
    moves_switches,
    scattered,
    switch_shifts,
)
from rigctl.model.fit.unknowns import (
    LocalUnknown,
    assumed_unknowns,
    local_unknowns,
    shared_unknowns,
    start_values,
    unrecorded_unknowns,
)
from rigctl.model.measured.clocks import clocks_of
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.model import Model
from rigctl.model.plant import initial_state
from rigctl.model.reading_errors import CalibrationError, ClockError, ReadingError, error_effects
from rigctl.noise.noise_model import NoiseModel
from rigctl.noise.whitening import Whitener, whiten
from rigctl.physics.family import ModelFamily
from rigctl.rig.rig import Rig

Floats = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True)
class Problem:
    """A model and its data, with everything that a fit, a comparison or a diagnosis needs.

    Attributes
    ----------
    model: as compiled; its free parameters are the unknowns.
    measurements, noise: the data.
    ok: (n, outputs) of each record, the values that count: read, and not spikes.
    compiled: the equations, with the record-level quantities and, if requested, the library at its null.
    level: the record-level quantities.
    shared: the unknowns common to all records.
    local: those of each record.
    whiteners: of each record.
    base: (parameters) values of the system's parameters that are not unknowns.
    starts: of each record, the initial state as far as it is not unknown.
    signal: (n, outputs) of each record, the noise-free values to which proportional noise refers, from a fit;
        None for the measured ones.
    scatter: (n, outputs, k) of each record, scatter besides the noise that is not an unknown, for one
        standard deviation each: see `rigctl.noise.whitening.Whitener.with_scatter`; None if not yet known.
    grown: (n, outputs) of each record, the standard deviation of the noise of each reading, SI, if it depends
        on the measured value; else None.
    extra: (outputs) of each record, standard deviation of the contribution of measured inputs' noise to that
        of the outputs, SI; None if there is none.
    """

    model: Model
    measurements: Measurements
    noise: NoiseModel
    ok: tuple[NDArray[np.bool_], ...]
    compiled: CompiledSystem
    level: RecordLevel
    shared: tuple[Unknown, ...]
    local: tuple[tuple[LocalUnknown, ...], ...]
    whiteners: tuple[Whitener, ...] = field(repr=False)
    base: Floats = field(repr=False)
    starts: tuple[Floats, ...] = field(repr=False)
    signal: tuple[Floats, ...] | None = field(default=None, repr=False)
    scatter: tuple[Floats, ...] | None = field(default=None, repr=False)
    extra: tuple[Floats, ...] | None = field(default=None, repr=False)
    grown: tuple[Floats, ...] | None = field(default=None, repr=False)
    _recent: Recent = field(default_factory=Recent, init=False, repr=False, compare=False)

    @property
    def records(self) -> tuple[MeasuredRecord, ...]:
        """The records, in order."""
        return self.measurements.records

    @cached_property
    def content(self) -> tuple[object, ...]:
        """Everything on which its residuals and their derivatives depend, for comparison by
        `rigctl.engine.result_cache`.

        Names of the model and the records do not count. Unknown for a problem with a simulation of its own.
        """
        if type(self) is not Problem:
            return (self.simulate,)
        system, data = self.compiled.system, self.measurements
        # the same samples in another run, or under another label, give the same fit; which errors act in a
        # record is decided by its run's name, and so is kept beside it
        records = [replace(record, run="", index=0, label="") for record in data.records]
        errors = [replace(one, runs=()) for one in data.reading_errors]
        acting = [[one.acts_in(record.run) for one in data.reading_errors] for record in data.records]
        return (
            self.compiled.source.text,
            (system.states, system.inputs, system.parameter_names, system.output_names),
            [delay.input for delay in system.delays],
            (data.outputs, data.inputs, records, data.input_noise, errors, acting),
            self.noise,
            self.ok,
            (self.shared, self.local, self.base, self.starts),
            (self.whiteners, self.signal, self.scatter, self.extra, self.grown),
        )

    @cached_property
    def local_names(self) -> tuple[str, ...]:
        """Every record-level unknown of any record, each once, without the initial states."""
        return tuple(
            dict.fromkeys(one.name for unknowns in self.local for one in unknowns if one.kind != "start")
        )

    @cached_property
    def initial_names(self) -> tuple[str, ...]:
        """Every state whose initial value is unknown in some record, each once."""
        return tuple(
            dict.fromkeys(one.name for unknowns in self.local for one in unknowns if one.kind == "start")
        )

    def rebuilt(self, model: Model, *, library: bool = False, progress: Progress | None = None) -> Problem:
        """The problem of another model on these data; with `library`, with every other effect at its null.

        Raises
        ------
        RigctlError
            an effect's term cannot be added.
        """
        problem = self.for_model(model, library=library, whiteners=self.whiteners, progress=progress)
        return replace(problem, signal=self.signal, scatter=self.scatter, extra=self.extra)

    def for_model(
        self,
        model: Model,
        noise: NoiseModel | None = None,
        ok: Sequence[NDArray[np.bool_]] | None = None,
        *,
        library: bool = False,
        whiteners: Sequence[Whitener] | None = None,
        grown: tuple[Floats, ...] | None = None,
        progress: Progress | None = None,
    ) -> Problem:
        """Another model on the same measurements, or another noise; no other result of a fit is kept.

        All changes of the equations go through this method, and `simulate` is the only access to the
        equations.

        Raises
        ------
        RigctlError
            an effect's term cannot be added.
        """
        return make_problem(
            model,
            self.measurements,
            self.noise if noise is None else noise,
            self.ok if ok is None else ok,
            library=library,
            whiteners=whiteners,
            grown=self.grown if noise is None else grown,
            progress=progress,
        )

    def system_with(self, effect: Effect) -> System:
        """The equations of its model with one more effect at its null, not compiled.

        Raises
        ------
        RigctlError
            one of the effect's slots accepts no term.
        """
        given = {name: {p: value.si for p, value in one.items()} for name, one in self.model.effects.items()}
        return _built(_definition(self.model, given, self.level, self.measurements, (effect,)))

    def with_signal(self, outputs: Sequence[Floats]) -> Problem:
        """This problem, with proportional noise referred to the model's `outputs`.

        Referred to the measured values, it would bring their noise into the weights, and so into every
        derivative.
        """
        if not any(channel.share for channel in self.noise.channels):
            return self
        return replace(self, signal=tuple(outputs)).whitened()

    def scattered(self, shared: Floats, local: Sequence[Floats]) -> Problem:
        """This problem, with scatter that is no unknown included in the noise, linearised at these outputs.

        It consists of the times of switches in records with many of them.
        """
        named = [scattered(record) for record in self.records]
        if not any(names for names, _ in named):
            return self
        # ∂y/∂t_k times the standard deviation of t_k: to first order what the scatter of switch k adds to
        # each reading. The whitener takes these columns into the covariance, V + D·Dᵀ, which is the fit with
        # those times integrated out
        columns: list[Floats] = []
        for index, (names, std) in enumerate(named):
            if not names:
                columns.append(np.empty((*self.records[index].values.shape, 0)))
                continue
            simulated = self.only([index]).simulate(shared, [local[index]], names).require()
            columns.append(self._read_each(simulated.sensitivities)[0] * std)
        return replace(self, scatter=tuple(columns)).whitened()

    def whitened(self) -> Problem:
        """With whiteners for its noise, its signal, and its scatter."""
        signal = [record.values for record in self.records] if self.signal is None else self.signal
        extra = [None] * len(signal) if self.extra is None else self.extra
        whiteners = [
            whiten(self.noise, record.times, good, values, more, sigma)
            for record, good, values, more, sigma in zip(
                self.records, self.ok, signal, extra, self.grown or [None] * len(signal), strict=True
            )
        ]
        if self.scatter is not None:
            whiteners = [
                each.with_scatter(columns) if columns.shape[2] else each
                for each, columns in zip(whiteners, self.scatter, strict=True)
            ]
        return replace(self, whiteners=tuple(whiteners))

    def with_shared(self, shared: Sequence[Unknown], base: Floats | None = None) -> Problem:
        """This problem with other common unknowns, and other values of the remaining parameters.

        If only starts, bounds or priors differ, what was evaluated counts for both.
        """
        # an evaluation depends on the values of the unknowns in their order, and on the base: a fit that only
        # starts elsewhere, or has other bounds, takes over what is known
        changed = replace(self, shared=tuple(shared), base=self.base if base is None else base)
        if base is None and [one.name for one in shared] == [one.name for one in self.shared]:
            object.__setattr__(changed, "_recent", self._recent)
        return changed

    def with_known(self, values: Mapping[str, float]) -> Problem:
        """This problem with `values`, SI, of common unknowns that are no longer unknown."""
        base = self.base.copy()
        for name, value in values.items():
            base[self._index[name]] = value
        return self.with_shared([one for one in self.shared if one.name not in values], base)

    def with_unknowns_of(self, other: Problem) -> Problem:
        """This problem with the common unknowns of another of the same model; the others keep their values
        there."""
        unknown = {one.name for one in other.shared}
        known = (one.name for one in self.shared if one.name not in unknown)
        return self.with_known({name: float(other.base[other._index[name]]) for name in known})

    def fresh(self) -> Problem:
        """This problem without remembered evaluations."""
        return replace(self)

    def only(self, indices: Iterable[int]) -> Problem:
        """These records alone; the problem itself if they are all of them."""
        chosen = list(indices)
        if chosen == list(range(len(self.records))):
            return self

        def pick(items: Sequence[T]) -> tuple[T, ...]:
            return tuple(items[index] for index in chosen)

        return replace(
            self,
            measurements=self.measurements.only(chosen),
            ok=pick(self.ok),
            local=pick(self.local),
            whiteners=pick(self.whiteners),
            starts=pick(self.starts),
            signal=None if self.signal is None else pick(self.signal),
            scatter=None if self.scatter is None else pick(self.scatter),
            extra=None if self.extra is None else pick(self.extra),
            grown=None if self.grown is None else pick(self.grown),
        )

    def at_samples(self, chosen: Sequence[NDArray[np.intp]]) -> Problem:
        """The records at some of their samples each."""
        records = tuple(
            replace(record, times=record.times[at], values=record.values[at], phase=record.phase[at])
            for record, at in zip(self.records, chosen, strict=True)
        )

        def pick(items: Sequence[Floats] | None) -> tuple[Floats, ...] | None:
            return None if items is None else tuple(one[at] for one, at in zip(items, chosen, strict=True))

        return replace(
            self,
            measurements=replace(self.measurements, records=records),
            ok=tuple(good[at] for good, at in zip(self.ok, chosen, strict=True)),
            signal=pick(self.signal),
            scatter=pick(self.scatter),
            grown=pick(self.grown),
        ).whitened()

    def local_unknowns(self) -> list[list[Unknown]]:
        """The unknowns of each record, in the form required by `least_squares`."""
        return [[one.unknown for one in unknowns] for unknowns in self.local]

    def simulate(
        self,
        shared: Floats,
        local: Sequence[Floats],
        columns: Sequence[str] = (),
        *,
        initial: bool = False,
        splines: SplineColumns = NO_SPLINES,
    ) -> Trajectories:
        """The model's outputs, with derivatives by `columns`, by the shapes of terms and, if requested, by
        the initial states."""
        # a column is one of three kinds: a parameter of the equations; what moves switches, for which the
        # engine needs the shift of each switch (`Excitation.shifts`); an error of a calibration or a clock,
        # which acts on outputs alone and is added at the end
        moving = tuple(name for name in columns if moves_switches(name))
        read = {one.name for one in (*self._calibrations, *self._clocks)}
        plain = tuple(name for name in columns if not moves_switches(name) and name not in read)
        excitations = [self.excitation(index, shared, values, moving) for index, values in enumerate(local)]
        starts = self.initial_names if initial else ()
        simulated = simulate_soundly(self.compiled, excitations, plain, starts, moving, splines)
        for index, record in enumerate(self.records):
            # the parameter that stands for an input where it was not recorded, or for the error of another
            # calibration, does not act in this record: `excitation` has set it to zero, its column follows
            recorded = [simulated.columns.index(name) for name in self._recorded(record) if name in plain]
            if recorded:
                simulated.sensitivities[index][:, :, recorded] = 0.0
        every = range(len(self.records))
        return self._as_read(simulated, every, excitations, [shared] * len(every), local, columns)

    def at_draws(self, index: int, draws: Floats, local: Floats) -> Trajectories:
        """The outputs of one record at each draw of the common unknowns (draws, p), all at once."""
        excitations = [self.excitation(index, one, local) for one in draws]
        simulated = simulate(self.compiled, excitations)
        count = len(draws)
        return self._as_read(simulated, [index] * count, excitations, list(draws), [local] * count)

    def _as_read(
        self,
        simulated: Trajectories,
        indices: Sequence[int],
        excitations: Sequence[Excitation],
        shared: Sequence[Floats],
        local: Sequence[Floats],
        columns: Sequence[str] = (),
    ) -> Trajectories:
        """Each trajectory as sensors with these errors of their calibrations and clocks read it.

        They act on outputs alone, so that neither they nor their derivatives need be integrated.

        Parameters
        ----------
        indices, excitations, shared, local: the record of each trajectory, and its unknowns.
        """
        if self._clocks:
            simulated = self._as_dated(simulated, indices, excitations, shared, local, columns)
        if not self._calibrations:
            return simulated
        fixed = {one.name: float(self.base[self._index[one.name]]) for one in self._calibrations}
        names = [unknown.name for unknown in self.shared]
        values = [fixed | dict(zip(names, one.tolist(), strict=True)) for one in shared]
        runs = [self.records[index].run for index in indices]
        return as_read(simulated, runs, self._calibrations, values, columns)

    def _as_dated(
        self,
        simulated: Trajectories,
        indices: Sequence[int],
        excitations: Sequence[Excitation],
        shared: Sequence[Floats],
        local: Sequence[Floats],
        columns: Sequence[str],
    ) -> Trajectories:
        """Each trajectory at the times at which its readings were taken."""

        def difference(k: int, clock: ClockError) -> Floats:
            # the errors of both integrations are divided by 2·step, which is why they are made with tight
            # tolerance
            step = STEP * clock.std
            ends = [
                self.excitation(indices[k], shared[k], local[k], moved={clock.name: by})
                for by in (step, -step)
            ]
            simulated = simulate(self.compiled, ends, tolerance=TIGHT)
            if not simulated.ok:  # too stiff for that: the usual tolerance is better than no answer
                simulated = simulate(self.compiled, ends)
            outputs = simulated.require().outputs
            late, early = (
                self._read_times(indices[k], end.parameters).of(each)
                for end, each in zip(ends, outputs, strict=True)
            )
            return np.asarray((late - early) / (2.0 * step))

        return as_dated(
            simulated,
            [self.records[index] for index in indices],
            [
                self._read_times(index, one.parameters)
                for index, one in zip(indices, excitations, strict=True)
            ],
            [one for one in self._clocks if one.name in columns],
            difference,
        )

    @cached_property
    def _calibrations(self) -> tuple[CalibrationError, ...]:
        """The errors of the calibrations of outputs; those of inputs are in the equations."""
        return tuple(
            one
            for one in self.measurements.reading_errors
            if isinstance(one, CalibrationError) and one.channel in self.measurements.outputs
        )

    @cached_property
    def _clocks(self) -> tuple[ClockError, ...]:
        """The clocks that may be off."""
        return tuple(clocks_of(self.measurements))

    def _offsets(self, record: MeasuredRecord, parameters: Floats) -> dict[str, float]:
        """By how much the clock of each channel is behind in a record, s; a row has no time."""
        return {
            channel: float(parameters[self._index[one.name]])
            for one in self._clocks
            if one.acts_in(record.run) and not record.row
            for channel in one.channels
        }

    def _read_times(self, index: int, parameters: Floats) -> ReadTimes:
        """When the outputs of a record were read."""
        record = self.records[index]
        return read_times(record, self.compiled.system.output_names, self._offsets(record, parameters))

    def parts(self, columns: int) -> list[list[int]]:
        """The records, in order, in parts whose derivatives by this many columns fit into memory."""
        shares: list[list[int]] = []
        room = 0
        for index, record in enumerate(self.records):
            wanted = record.times.size * len(self.compiled.system.outputs) * max(columns, 1)
            if not shares or wanted > room:
                shares.append([])
                room = ROOM
            shares[-1].append(index)
            room -= wanted
        return shares

    def evaluate(self, shared: Floats, local: Sequence[Floats], derivatives: bool) -> list[Block] | Refused:
        """Whitened residuals ``W(f − y)`` and their derivatives; for `least_squares`."""
        point = point_of(shared, local)
        known = self._recent.at(point, derivatives)
        if known is not None:
            return known.blocks
        evaluated = self._evaluated(shared, local, derivatives)
        if isinstance(evaluated, Refused):
            return evaluated
        if evaluated.blocks:
            unknowns = len(self.shared) + len(self.local_names) + len(self.initial_names)
            self._recent.keep(point, 1 + unknowns if derivatives else 0, evaluated)
        return evaluated.blocks

    def outputs_at(self, shared: Floats, local: Sequence[Floats]) -> tuple[Floats, ...]:
        """(n, outputs) of each record, the model's predictions of the measured outputs.

        A recent evaluation at the same point is reused.

        Raises
        ------
        RigctlError
            a record cannot be simulated there.
        """
        known = self._recent.at(point_of(shared, local), derivatives=False)
        if known is not None:
            return tuple(known.outputs)
        return tuple(self._read_each(self.simulate(shared, local).require().outputs))

    def _evaluated(self, shared: Floats, local: Sequence[Floats], derivatives: bool) -> Evaluated | Refused:
        names = [unknown.name for unknown in self.shared]
        columns = tuple(dict.fromkeys([*names, *self.local_names])) if derivatives else ()
        # residuals are whitened now, derivatives when they are first used: those of a rejected step never are
        blocks: list[Block] = []
        readings: list[Floats] = []
        for part in self.parts(len(columns) + len(self.initial_names)):
            inner = self if len(part) == len(self.records) else self.only(part)
            simulated = inner.simulate(shared, [local[index] for index in part], columns, initial=derivatives)
            if not simulated.ok:
                return Refused(simulated.summary())
            readings += self._read_each(simulated.outputs)
            for at, (index, outputs) in enumerate(zip(part, readings[-len(part) :], strict=True)):
                later = partial(self._derivatives, index, simulated, at, names) if derivatives else None
                blocks.append(Block(self._residual(index, outputs), later=later))
        return Evaluated(blocks, readings)

    @cached_property
    def channels(self) -> NDArray[np.intp]:
        """The indices of the measured outputs among the system's."""
        known = self.compiled.system.output_names
        return np.array([known.index(name) for name in self.measurements.outputs], dtype=np.intp)

    @cached_property
    def sigma(self) -> tuple[Floats, ...]:
        """(n, outputs) of each record, the standard deviation of each reading, SI."""
        signal = [record.values for record in self.records] if self.signal is None else self.signal
        sigmas = list(self.grown or [self.noise.sigma_at(values) for values in signal])
        if self.extra is not None:
            sigmas = [np.hypot(sigma, more) for sigma, more in zip(sigmas, self.extra, strict=True)]
        return tuple(sigmas)

    def _read_each(self, arrays: Sequence[Floats]) -> list[Floats]:
        return [self._read(array) for array in arrays]

    def _read(self, array: Floats) -> Floats:
        """The measured outputs alone, of values or derivatives of all of them; no copy if those are all."""
        if np.array_equal(self.channels, np.arange(array.shape[1])):
            return array
        return np.take(array, self.channels, axis=1)

    def excitation(
        self,
        index: int,
        shared: Floats,
        values: Floats,
        moving: Sequence[str] = (),
        *,
        moved: Mapping[str, float] | None = None,
    ) -> Excitation:
        """The record as an excitation for the engine.

        Parameters
        ----------
        moving: the unknowns whose time shifts are needed.
        moved: what is added to parameters.
        """
        record, system = self.records[index], self.compiled.system
        # parameters: the base, then the shared unknowns, then what is special to this record
        parameters, start = self.base.copy(), self.starts[index].copy()
        switching: dict[str, float] = {}
        for unknown, value in zip(self.shared, shared, strict=True):
            parameters[self._index[unknown.name]] = value
        for name in self._recorded(record):
            parameters[self._index[name]] = 0.0  # the value is among the inputs
        for name, by in (moved or {}).items():
            parameters[self._index[name]] += by
        # the record's own unknowns: an initial state is a value, a switch has a shift of its time, and all
        # others are deviations, which add to the value that the records share
        for one, value in zip(self.local[index], values, strict=True):
            if one.kind == "start":
                start[system.state_names.index(one.name)] = value
            elif one.kind == "switch":
                switching[one.name] = float(value)
            else:
                parameters[self._index[one.name]] += value
        # times: of the commands, by the logger's delays and the record's own shifts; of the readings, and of
        # measured inputs, by the offsets of the clocks that dated them
        delays = {name: float(parameters[self._index[name]]) for name in LOGGER_DELAYS}
        times = moved_times(record, switching | {name: value for name, value in delays.items() if value})
        shifts = switch_shifts(record, moving) if moving else None
        sampled, ramps = record.times, record.ramps
        if self._clocks:
            ramps = moved_ramps(record, self.measurements.inputs, self._offsets(record, parameters))
            sampled = self._read_times(index, parameters).every
        return Excitation(sampled, times, record.inputs, start, parameters, record.label, shifts, ramps)

    def _recorded(self, record: MeasuredRecord) -> list[str]:
        """The parameters of inputs that do not act in this record, fitted or not.

        Those of inputs that some records lack and this one has, and of other calibrations of a measured one.
        """
        of_inputs = set(self.measurements.reading_errors) - {*self._calibrations, *self._clocks}
        return [
            *(qualified(RECORD, name) for name in self.level.inputs if name not in record.unrecorded),
            *(one.name for one in of_inputs if not one.acts_in(record.run)),
        ]

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.compiled.system.parameter_names)}

    def _residual(self, index: int, outputs: Floats) -> Floats:
        """Whitened, of the record at `index`."""
        ok, values = self.ok[index], self.records[index].values
        return self.whiteners[index](np.where(ok, outputs - np.where(ok, values, 0.0), 0.0))

    def _derivatives(
        self, index: int, simulated: Trajectories, at: int, names: Sequence[str]
    ) -> tuple[Floats, Floats]:
        """Its derivatives, whitened, by the unknowns `names` and by its own; it is the `at`-th simulated
        one."""
        white = self.whiteners[index](self._read(simulated.sensitivities[at]))
        column_of = {name: k for k, name in enumerate(simulated.columns)}
        record_local = [column_of[one.name] for one in self.local[index]]
        return _columns(white, [column_of[name] for name in names]), _columns(white, record_local)


def _columns(matrix: Floats, columns: Sequence[int]) -> Floats:
    """Some columns of a matrix: without a copy where they are neighbours, in order."""
    first, count = columns[0] if columns else 0, len(columns)
    if list(columns) == list(range(first, first + count)):
        return matrix[:, first : first + count]
    return matrix[:, columns]


def make_problem(
    model: Model,
    measurements: Measurements,
    noise: NoiseModel,
    ok: Sequence[NDArray[np.bool_]],
    *,
    library: bool = False,
    whiteners: Sequence[Whitener] | None = None,
    grown: tuple[Floats, ...] | None = None,
    progress: Progress | None = None,
) -> Problem:
    """A model on its data; with `library`, every other effect is included at its null.

    Parameters
    ----------
    whiteners: of the same data, if they exist already.
    grown: (n, outputs) of each record, SI, σ of each reading if known; by default from the smoothed readings,
        if the noise depends on the measured value.

    Raises
    ------
    RigctlError
        an effect's term cannot be added.
    """
    # what differs from record to record: what the family declares, a level for each setting of a table,
    # inputs that some record lacks, and settings that do not repeat exactly. They are parameters of one
    # effect, so that all records have the same equations, compiled once
    level, settings = level_of_rows(record_level(model.family), measurements)
    level = level.with_inputs(list(measurements.unrecorded), model.family)
    level = level.with_repeatability(repeatability(measurements, model.family), model.family)
    # the equations: with `library`, one integration gives the derivatives by every effect that could be
    # missing
    effects = {name: {p: value.si for p, value in values.items()} for name, values in model.effects.items()}
    everything = superset(model.family, effects, model.own_effects) if library else effects
    compiled = _compiled(_definition(model, everything, level, measurements), progress)
    system = compiled.system
    used = [effect for effect in map(model.effect, everything) if effect.terms]
    usual = initial_state(model.family, used)
    records = measurements.records
    # the weights: noise that depends on the level needs one for each reading, from the smoothed readings,
    # since the noise of a reading would otherwise enter its own weight
    grown = _grown(noise, records, ok) if grown is None else grown
    if whiteners is None:
        whiteners = [
            whiten(noise, r.times, good, r.values, sigma=sigma)
            for r, good, sigma in zip(records, ok, grown or [None] * len(records), strict=True)
        ]
    # the unknowns: the common ones of the model, of what it assumes, of the logger and the sensors; and each
    # record's own
    starts = [start_values(level, record, measurements, usual, model.values) for record in records]
    return Problem(
        model=model,
        measurements=measurements,
        noise=noise,
        ok=tuple(ok),
        compiled=compiled,
        level=level,
        shared=(
            *shared_unknowns(model),
            *assumed_unknowns(model),
            *logger_delay_unknowns(measurements),
            *settings,
            *unrecorded_unknowns(measurements),
            *(replace(one.unknown, linear=_linear(one, measurements)) for one in measurements.reading_errors),
        ),
        local=tuple(
            local_unknowns(level, record, measurements, start)
            for record, start in zip(records, starts, strict=True)
        ),
        whiteners=tuple(whiteners),
        base=np.array(system.nominal, dtype=float),
        starts=tuple(np.array([start[name] for name in system.state_names]) for start in starts),
        grown=grown,
    )


def _linear(error: ReadingError, measurements: Measurements) -> bool:
    """Whether readings are linear in an error: in one of a clock, or of an input, which is in the equations,
    they are not."""
    return isinstance(error, CalibrationError) and error.channel in measurements.outputs


#: a family, effects, bench, parameters, oil, own effects, unrecorded inputs, errors of inputs' calibrations
_Definition = tuple[
    ModelFamily,
    Mapping[str, Mapping[str, float]],
    Rig | None,
    Mapping[str, float],
    str | None,
    tuple[Effect, ...],
    tuple[str, ...],
    tuple[CalibrationError, ...],
]


def _definition(
    model: Model,
    effects: Mapping[str, Mapping[str, float]],
    level: RecordLevel,
    measurements: Measurements,
    further: Sequence[Effect] = (),
) -> _Definition:
    """What determines a system of equations, with everything that a measurement leaves uncertain.

    `effects` are those of the model with their parameters, `further` others, each at its null.
    """
    read_wrong = measurements.reading_errors
    uncertain = (
        *(() if level.effect is None else (level.effect,)),
        *error_effects(model.family, read_wrong),
    )
    return (
        model.family,
        {**effects, **{one.name: one.null for one in (*uncertain, *further)}},
        measurements.rig or model.rig,
        {name: value for name, value in model.values.items() if "." not in name},
        model.oil,
        (*model.own_effects, *uncertain, *further),
        tuple(measurements.unrecorded),
        tuple(
            one
            for one in read_wrong
            if isinstance(one, CalibrationError) and one.channel in measurements.inputs
        ),
    )


def _built(definition: _Definition) -> System:
    """The system of equations of a definition."""
    family, effects, rig, parameters, oil, own_effects, unrecorded, read_wrong = definition
    return build_system(
        family,
        effects,
        rig,
        parameters=parameters,
        oil=oil,
        own_effects=own_effects,
        unrecorded=unrecorded,
        read_wrong=read_wrong,
    )


def _same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Whether two are equal; objects that hold arrays only if they are identical."""
    try:
        return bool(one == other)
    except ValueError:
        return False


#: the last systems compiled in this process, with their arguments
_COMPILED: list[tuple[_Definition, CompiledSystem]] = []
_MOST_COMPILED = 6


def _compiled(definition: _Definition, progress: Progress | None) -> CompiledSystem:
    """The compiled system of a definition.

    Deriving its equations takes as long as fitting a few records: many runs evaluated with one model share
    it.
    """
    for known, compiled in tuple(_COMPILED):  # other threads may be compiling
        if _same(known, definition):
            return compiled
    result = compile_system(_built(definition), progress=progress)
    _COMPILED.insert(0, (definition, result))
    del _COMPILED[_MOST_COMPILED:]
    return result


def _grown(
    noise: NoiseModel, records: Sequence[MeasuredRecord], ok: Sequence[NDArray[np.bool_]]
) -> tuple[Floats, ...] | None:
    """(n, outputs) σ of each reading from the smoothed values of its record; None if it is constant."""
    if all(channel.law is None for channel in noise.channels):
        return None
    return tuple(
        noise.sigma_at(np.where(good, record.values, np.nan), record.times)
        for record, good in zip(records, ok, strict=True)
    )
