"""Measurements in terms of a model: its commanded inputs and measured outputs.

Made by `read` and `observations`, and turned into the engine's excitations by `Problem.excitation`. Commands
are steps, at times of which some are known only to within a sample; measured inputs are lines between their
readings; outputs are readings, NaN where there is none. A row of a table is a record of one instant.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.excitation import Ramps
from rigctl.model.measured.note import Note
from rigctl.model.reading_errors import ReadingError
from rigctl.rig.rig import Rig
from rigctl.units import parse_unit

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]

#: standard deviation of a uniform distribution, in half-widths
UNIFORM = 1.0 / math.sqrt(3.0)
#: times known better than this, in s and as a share of the sampling interval, are exact
_EXACT, _EXACT_SHARE = 2e-4, 0.25
#: a command that changes with more than this share of the samples is calculated anew for each of them
_OF_SAMPLES = 0.5


@dataclass(frozen=True)
class MeasuredRecord:
    """One record; everything SI, times in s from its first sample.

    Attributes
    ----------
    run, index: where it was recorded.
    label: its name, with its number as shown by `rigctl runs show`: ``20261121-064412-campaign/3``.
    times: (n) of the samples, increasing.
    switch_times: (switches) times of commands, the first not after the first sample.
    switch_half: (switches) half-widths of these times; 0 for exact ones.
    inputs: (switches, inputs) commanded from each of these times on, in the family's order.
    values: (n, outputs) readings of the sensors; NaN where there is none.
    condition: the operating point: sweep values, or what else distinguishes the records.
    group: records with the same number were measured at one condition with the same commands.
    phase: (n) index of the period of constant commands of each sample.
    phases: the names of these periods.
    row: a row of a table: single values at one operating point, without a time axis.
    beside: for a row, the values of its other columns, SI.
    along: the indices of the inputs that change continuously; `inputs` holds their middle.
    knots, lines: (k) times and (k, along) values between which they are linear.
    unrecorded: for inputs that were not recorded, the lowest and the highest value, SI; 0 in `inputs`.
    switch_jitter: (switches) s, stated standard deviations of the times at which the actuators act, from one
        command to the next; empty where none is stated.
    separate_switches: the time of each switch that is not exact is an unknown, even if there are many.
    """

    run: str
    index: int
    label: str
    times: Floats
    switch_times: Floats
    switch_half: Floats
    inputs: Floats
    values: Floats
    condition: Mapping[str, float]
    group: int
    phase: Integers
    phases: tuple[str, ...]
    row: bool = False
    beside: Mapping[str, float] = field(default_factory=dict)
    along: tuple[int, ...] = ()
    knots: Floats = field(default_factory=lambda: np.empty(0), repr=False)
    lines: Floats = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    unrecorded: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    separate_switches: bool = False
    switch_jitter: Floats = field(default_factory=lambda: np.empty(0), repr=False)

    @cached_property
    def ramps(self) -> Ramps | None:
        """The inputs that change continuously, in the engine's form."""
        return Ramps(np.array(self.along), self.knots, self.lines) if self.along else None

    @cached_property
    def samples_of_phases(self) -> tuple[Integers, ...]:
        """For each phase the indices of its samples, in order; empty for one between two samples.

        A mask of all samples for each phase would take a time proportional to the square of the length of a
        record with a command at every sample.
        """
        order = np.argsort(self.phase, kind="stable")
        starts = np.searchsorted(self.phase[order], np.arange(len(self.phases) + 1))
        return tuple(order[first:last] for first, last in pairwise(starts.tolist()))

    @cached_property
    def logged_switches(self) -> Integers:
        """The indices of the switches that were recorded with a sample, without the first command."""
        return self._inexact(self.switch_half)

    @cached_property
    def rough_switches(self) -> Integers:
        """The indices of the switches whose times are not exact, without the first command.

        Of commands that change with most of the samples, none acts at a time of its own.
        """
        return self.logged_switches if self.streamed else self._inexact(self.switch_std / UNIFORM)

    @cached_property
    def switch_std(self) -> Floats:
        """(switches) standard deviations of the times of the switches, s: where in the interval between two
        samples a command was given, and when its actuator acts after that."""
        return np.hypot(self.switch_half * UNIFORM, self.jitter)

    @cached_property
    def jitter(self) -> Floats:
        """(switches) `switch_jitter`, zero where none is stated."""
        return self.switch_jitter if self.switch_jitter.size else np.zeros(self.switch_half.size)

    def _inexact(self, half: Floats) -> Integers:
        step = float(np.median(np.diff(self.times))) if self.times.size > 1 else np.inf
        rough = (half >= _EXACT) | (half >= _EXACT_SHARE * step)
        return np.flatnonzero(rough[1:]) + 1

    @cached_property
    def streamed(self) -> bool:
        """Whether a command changes with most of the samples: a controller or a generator writes it.

        All its times are then late by the same. A delay of its rises and another of its falls would add their
        difference times the sum of all rises to its integral, as an offset does, and the scatter of each time
        would add a random walk: a drift of the output would count as either.
        """
        return bool(self._inexact(self.switch_std / UNIFORM).size > _OF_SAMPLES * self.times.size)

    @cached_property
    def switch_kinds(self) -> Integers:
        """(switches) 0 for a larger value, 1 for a smaller one, 2 for 0, of the input with the largest
        change; all are of one kind in a record of streamed commands."""
        if self.inputs.shape[1] == 0 or self.streamed:  # none at all: a free pendulum
            return np.zeros(len(self.inputs), dtype=np.intp)
        # the input that changed most, in units of its range: a switch of several at once is of its kind
        changes = np.diff(self.inputs, axis=0, prepend=self.inputs[:1])
        width = np.ptp(self.inputs, axis=0)
        index = np.argmax(np.abs(changes) / np.where(width > 0.0, width, 1.0), axis=1)
        row = np.arange(len(index))
        kinds = np.where(changes[row, index] > 0.0, 0, 1)
        return np.asarray(np.where(self.inputs[row, index] == 0.0, 2, kinds), dtype=np.intp)

    def input_course(self, index: int) -> Floats:
        """(n) the input at `index`, SI, at the samples."""
        if index in self.along:
            return np.interp(self.times, self.knots, self.lines[:, self.along.index(index)])
        # a sample at a switch belongs to the period before it, as in `phases_of`
        last = np.searchsorted(self.switch_times, self.times, side="left") - 1
        return np.asarray(self.inputs[np.maximum(last, 0), index])

    @property
    def here(self) -> NDArray[np.bool_]:
        """(n, outputs) where a value was read."""
        return np.isfinite(self.values)


@dataclass(frozen=True)
class Measurements:
    """Records of one or more runs, for one model.

    Attributes
    ----------
    outputs: the channels, in the order of a record's values.
    units: in which each is shown.
    inputs: the model's inputs, in the order of a record's.
    rig: the bench at the time of recording; None for a table without a bench.
    runs: the ids.
    notes: what a reader should know about how the data were taken.
    columns: for a table, the unit of each of its columns.
    titles: for a table, the column from which an output was read if its name differs, e.g. ``stroke``.
    input_noise: standard deviation of a reading, SI, of the inputs that change continuously, if known.
    reading_errors: how wrong the calibration of each channel may be, of outputs and of measured inputs, where
        the rig file says in what.
    possible_errors: the same where it states an uncertainty alone: sensors are exact in fits, but where that
        shows an error of the model, it is fitted with these.
    """

    outputs: tuple[str, ...]
    units: tuple[str, ...]
    inputs: tuple[str, ...]
    records: tuple[MeasuredRecord, ...]
    rig: Rig | None
    runs: tuple[str, ...]
    notes: tuple[Note, ...] = ()
    columns: Mapping[str, str] = field(default_factory=dict)
    titles: Mapping[str, str] = field(default_factory=dict)
    input_noise: Mapping[str, float] = field(default_factory=dict)
    reading_errors: tuple[ReadingError, ...] = ()
    possible_errors: tuple[ReadingError, ...] = ()

    @property
    def table(self) -> bool:
        """True if the data are only rows of a table: no record has a time axis."""
        return bool(self.records) and all(record.row for record in self.records)

    @property
    def samples(self) -> int:
        """The number of values read."""
        return int(sum(record.here.sum() for record in self.records))

    @property
    def variables(self) -> tuple[str, ...]:
        """The names of the conditions that differ between records."""
        names = dict.fromkeys(name for record in self.records for name in record.condition)
        return tuple(
            name for name in names if len({record.condition.get(name) for record in self.records}) > 1
        )

    @property
    def unrecorded(self) -> dict[str, tuple[float, float]]:
        """The inputs not recorded in some record: lowest and highest value over these, SI."""
        spans: dict[str, tuple[float, float]] = {}
        for record in self.records:
            for name, (low, high) in record.unrecorded.items():
                lowest, highest = spans.get(name, (low, high))
                spans[name] = (min(low, lowest), max(high, highest))
        return dict(sorted(spans.items()))

    def unit_of(self, output: str) -> str:
        """The unit in which an output is shown."""
        return self.units[self.outputs.index(output)]

    def unit_for(self, si: str, *, interval: bool = False) -> str:
        """The display unit of such a quantity on this bench: that of a channel of its dimension, else SI.

        Parameters
        ----------
        interval: of a temperature, a difference of two.
        """
        if si == "K":
            return si if interval else "degC"
        dimension = parse_unit(si).dimension
        return next((unit for unit in self.units if parse_unit(unit).dimension == dimension), si)

    def jitter_of(self, rows: Floats) -> Floats:
        """(switches) stated jitter of the switches of a planned record, s: the largest with which the same
        inputs change in these records.

        Parameters
        ----------
        rows: (switches, inputs) SI, from each switch on.
        """
        of_input = np.zeros(len(self.inputs))
        for record in self.records:
            changed = np.diff(record.inputs, axis=0, prepend=record.inputs[:1]) != 0.0
            of_input = np.maximum(of_input, (changed * record.jitter[:, None]).max(axis=0))
        changed = np.diff(rows, axis=0, prepend=rows[:1]) != 0.0
        return np.asarray((changed * of_input).max(axis=1, initial=0.0))

    def only(self, indices: Iterable[int]) -> Measurements:
        """These records alone."""
        return replace(self, records=tuple(self.records[index] for index in indices))
