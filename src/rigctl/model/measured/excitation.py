"""The inputs of one record: commands as steps, measured inputs as lines, and unrecorded ones.

A command holds until the next one; a measured input (room temperature, a supply, a load) is linear between
its readings. A family may declare otherwise for an input (``hold``). An input that neither the run nor the
user gives is not zero: it is an unknown of the record, within the rig's range.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.dataset.run import Record, Run
from rigctl.model.inputs import InputSource
from rigctl.noise import find_spikes
from rigctl.rig.actuator import Actuator
from rigctl.rig.rig import Rig

Floats = NDArray[np.float64]

#: possible values of actuators with positions, SI
_POSITIONS = {"switch": (0.0, 1.0), "directional_valve": (-1.0, 1.0)}


@dataclass(frozen=True)
class Acting:
    """The inputs of a record.

    Attributes
    ----------
    times: (switches) s from the first sample, increasing; the first is 0.
    half: (switches) half-widths of these times.
    jitter: (switches) s, stated standard deviations of the times at which their actuators act.
    rows: (switches, inputs) SI, from each of these times on.
    commanded: (switches, inputs) the same with the middle of measured inputs in their place, for names.
    lines: (n, r) at the samples, of the inputs `along`, which change continuously.
    along: indices among the inputs.
    unrecorded: for inputs that were not recorded, the lowest and the highest value, SI.
    absent: the actuators of these inputs.
    taken: for inputs with unknown values, the family's value used for them, SI.
    bridged, spikes: by input, the number of missing readings, and of spikes.
    """

    times: Floats
    half: Floats
    jitter: Floats
    rows: Floats
    commanded: Floats
    lines: Floats
    along: tuple[int, ...]
    unrecorded: Mapping[str, tuple[float, float]]
    absent: Mapping[str, tuple[str, ...]]
    taken: Mapping[str, float]
    bridged: Mapping[str, int]
    spikes: Mapping[str, int]


def with_stated_values(sources: Sequence[InputSource], assumed: Mapping[str, float]) -> list[InputSource]:
    """The sources with the user's values of their inputs or actuators, SI, in place of recorded ones."""
    result = []
    for source in sources:
        if source.input in assumed:
            result.append(replace(source, value=assumed[source.input], actuators=(), channel=None, said=True))
            continue
        known = sum(factor * assumed[name] for name, factor in source.actuators if name in assumed)
        rest = tuple((name, factor) for name, factor in source.actuators if name not in assumed)
        stated = source.said or len(rest) < len(source.actuators)
        result.append(replace(source, value=source.value + known, actuators=rest, said=stated))
    return result


def unrecorded_actuators(source: InputSource, run: Run) -> list[str]:
    """The actuators of an input whose commands a run does not contain."""
    return [name for name, _ in source.actuators if name not in run.layout.commands]


def actuator_range(actuator: Actuator) -> tuple[float, float]:
    """The range of commands of an actuator, SI; infinite where its rig file has no limit."""
    if actuator.kind in _POSITIONS:
        return _POSITIONS[actuator.kind]
    low, high = actuator.low, actuator.high
    return (-math.inf if low is None else low, math.inf if high is None else high)


def acting(record: Record, run: Run, rig: Rig, sources: Sequence[InputSource]) -> Acting:
    """The inputs in a record of `run`, in the order of `sources`; times from its first sample."""
    # each input is a constant, steps at times of its own, or a line; steps of all inputs are then merged to
    # rows, one for each time at which any of them changes
    builder = _Builder(record, run, rig, len(sources))
    for index, source in enumerate(sources):
        if source.actuators:
            builder.commanded(index, source)
        elif source.channel is not None:
            builder.measured(index, source)
        else:
            builder.unmeasured(index, source)
    builder.straighten()
    times, half, jitter, rows = builder.rows()
    # names of phases are those of commands: what is only measured would make a phase of each reading
    commanded = rows.copy()
    for index, source in enumerate(sources):
        if not source.actuators:
            commanded[:, index] = np.median(commanded[:, index])
    lines = builder.lines
    return Acting(
        times=times - float(record.time[0]),
        half=half,
        jitter=jitter,
        rows=rows,
        commanded=commanded,
        lines=np.column_stack(list(lines.values())) if lines else np.empty((record.time.size, 0)),
        along=tuple(lines),
        unrecorded=builder.unrecorded,
        absent=builder.absent,
        taken=builder.taken,
        bridged=builder.bridged,
        spikes=builder.spikes,
    )


class _Builder:
    """Collects the changes of inputs on the record's own time axis."""

    def __init__(self, record: Record, run: Run, rig: Rig, inputs: int) -> None:
        self._record, self._run, self._rig = record, run, rig
        self._first = np.zeros(inputs)
        #: time, half-width, jitter, place, value
        self._changes: list[tuple[float, float, float, int, float]] = []
        self.lines: dict[int, Floats] = {}
        self.unrecorded: dict[str, tuple[float, float]] = {}
        self.absent: dict[str, tuple[str, ...]] = {}
        self.taken: dict[str, float] = {}
        self.bridged: dict[str, int] = {}
        self.spikes: dict[str, int] = {}

    def constant(self, index: int, value: float) -> None:
        self._first[index] = value

    def unmeasured(self, index: int, source: InputSource) -> None:
        """An input that is not recorded: its given value, else the family's, which must be known."""
        self.constant(index, source.value)
        if not source.said:
            self.taken[source.input] = source.value

    def commanded(self, index: int, source: InputSource) -> None:
        """An input of actuators: their commands, or the range of commands if there are none."""
        absent = unrecorded_actuators(source, self._run)
        if absent:
            self.unrecorded[source.input] = _span(source, absent, self._rig)
            self.absent[source.input] = tuple(absent)
        elif source.hold == "linear":
            # a command that the family declares linear, as a generator's between its samples
            self.lines[index] = source.value + _sum(source, self._record)
        else:
            self.switched(index, source)

    def measured(self, index: int, source: InputSource) -> None:
        """An input with a channel: its readings, else its given value, or its range."""
        readings = self.readings(source)
        if readings is None:
            # a channel that this record lacks: unknown within the sensor's range, rather than the family's
            # value, which nobody has measured
            span = _said_range(source, self._rig)
            if span is not None:
                self.unrecorded[source.input] = span
            else:
                self.unmeasured(index, source)
        elif source.hold == "previous":
            self.steps(index, readings)
        else:
            self.lines[index] = readings

    def straighten(self) -> None:
        """A line that never changes becomes a constant; for the others the middle is put among the
        commands."""
        for index, values in list(self.lines.items()):
            self.constant(index, float(np.median(values)))
            if np.ptp(values) == 0.0:
                del self.lines[index]

    def switched(self, index: int, source: InputSource) -> None:
        """The actuators' commands: their values at the first sample, and every switch.

        A command given at the time of the first sample holds from there on, whatever value that sample has.
        """
        record = self._record
        now = {name: _first(record.commands[name]) for name, _ in source.actuators}
        self._first[index] = last = source.of(now)
        begin, end = float(record.time[0]), float(record.time[-1])
        for switch in sorted(record.switches, key=lambda one: one.time):
            if switch.actuator not in now or not begin <= switch.time <= end:
                continue
            now[switch.actuator] = switch.value
            value = source.of(now)
            if switch.time == begin:
                self._first[index] = last = value
            elif value != last:
                jitter = self._rig.actuators[switch.actuator].jitter
                self._changes.append((switch.time, switch.uncertainty, jitter, index, value))
                last = value

    def steps(self, index: int, readings: Floats) -> None:
        """Readings that hold until the next one."""
        self._first[index] = readings[0]
        for k in (np.flatnonzero(np.diff(readings)) + 1).tolist():
            self._changes.append((float(self._record.time[k]), 0.0, 0.0, index, float(readings[k])))

    def readings(self, source: InputSource) -> Floats | None:
        """The readings of the input's channel, gaps and spikes bridged; None if it has none."""
        assert source.channel is not None  # noqa: S101 - called only for inputs with a channel
        values = self._record.channels.get(source.channel)
        if values is None or not np.isfinite(values).any():
            return None
        time = self._record.time
        # both: an input may jump, and back, on purpose; but hardly to where it never is otherwise
        spikes = _impossible(values) & find_spikes(time, values[:, None])[:, 0]
        good = np.isfinite(values) & ~spikes
        if not good.any():
            good = np.isfinite(values)
        missing = int((~np.isfinite(values)).sum())
        if missing:
            self.bridged[source.input] = missing
        if spikes.any():
            self.spikes[source.input] = int(spikes.sum())
        return np.asarray(np.interp(time, time[good], values[good]))

    def rows(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Times, half-widths, jitter and rows; simultaneous changes are one command."""
        times, half, jitter, rows = [float(self._record.time[0])], [0.0], [0.0], [self._first]
        # stable order: of two commands of one input at one time the later one holds
        for time, width, std, index, value in sorted(self._changes, key=lambda one: one[0]):
            if time != times[-1]:
                times.append(time)
                half.append(width)
                jitter.append(std)
                rows.append(rows[-1].copy())
            half[-1] = max(half[-1], width)
            jitter[-1] = max(jitter[-1], std)
            rows[-1][index] = value
        return np.array(times), np.array(half), np.array(jitter), np.array(rows)


def _impossible(values: Floats) -> NDArray[np.bool_]:
    """Far outside nearly all readings: an input may really jump, and back."""
    present = values[np.isfinite(values)]
    low, high = np.percentile(present, [1.0, 99.0])
    width = float(high - low)
    return np.asarray(np.isfinite(values) & ((values < low - width) | (values > high + width)))


def _first(values: Floats) -> float:
    present = values[np.isfinite(values)]
    return float(present[0]) if present.size else 0.0


def _sum(source: InputSource, record: Record) -> Floats:
    total = np.zeros(record.time.size)
    for name, factor in source.actuators:
        values = record.commands[name]
        good = np.isfinite(values)
        total += factor * (np.interp(record.time, record.time[good], values[good]) if good.any() else 0.0)
    return total


def _span(source: InputSource, absent: Sequence[str], rig: Rig) -> tuple[float, float]:
    """The range of an input whose actuators were not recorded."""
    low = high = source.value
    for name, factor in source.actuators:
        if name not in absent:
            continue
        ends = [factor * end for end in actuator_range(rig.actuators[name])]
        low, high = low + min(ends), high + max(ends)
    return low, high


def unknown_range(source: InputSource, rig: Rig) -> tuple[float, float] | None:
    """The range of an input that is no column of a table, SI; None if not given."""
    if source.said or not source.actuators:
        return _said_range(source, rig)
    ends = [
        sorted(factor * end for end in actuator_range(rig.actuators[name]))
        for name, factor in source.actuators
    ]
    low, high = (source.value + sum(end[k] for end in ends) for k in (0, 1))
    return (low, high) if math.isfinite(high - low) else None


def _said_range(source: InputSource, rig: Rig) -> tuple[float, float] | None:
    """The range of a measured input that this record lacks; None if the rig or the model gives its value."""
    if source.said or source.channel is None:
        return None
    span = rig.channels[source.channel].range
    return None if span is None or not math.isfinite(span[1] - span[0]) else (float(span[0]), float(span[1]))
