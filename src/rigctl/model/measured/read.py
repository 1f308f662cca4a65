"""Runs as measurements for a model: which commands were its inputs, which channels its outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigctl.dataset.run import Record, Run
from rigctl.errors import RigctlError
from rigctl.model.inputs import InputSource, input_sources
from rigctl.model.measured.groups import first_reading, group_numbers
from rigctl.model.measured.notes import notes
from rigctl.model.measured.observations import observed_records, titles
from rigctl.model.measured.phases import phases_of
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.measured.rigs import rig_of
from rigctl.model.measured.table import as_table
from rigctl.model.model import Model
from rigctl.rig.rig import Rig

#: a record with fewer samples tells nothing of a motion
_FEWEST_SAMPLES = 5
#: of more samples than these some are looked at, but never fewer of a record
_MOST_SAMPLES, _LEAST_OF_A_RECORD = 500_000, 400
#: before a channel's name: what it read at the start of a record
START = "start_"


def read_measurements(model: Model, runs: Sequence[Run]) -> Measurements:
    """The usable records of `runs` as `model` sees them.

    Raises
    ------
    RigctlError
        a run is of another rig, has none of the model's channels, no command of the model's, or no record
        that can be used.
    """
    rig = rig_of(model, runs)
    known = [output.name for output in model.family.outputs if rig is None or output.name in rig.channels]
    _require_channels(model, runs, known)
    records: list[MeasuredRecord] = []
    every = -(-sum(int(run.info["rows"]) for run in runs) // _MOST_SAMPLES)
    left_out = _thinned_note(every)
    for run in runs:
        if run.info["rows"]:
            found = _of_run(model, run, rig, known, every)
            left_out += _too_short(run, len(found))
            records += found
        else:
            records += observed_records(model, run, rig, known)
    _require_records(records, runs)
    present = [k for k in range(len(known)) if any(record.here[:, k].any() for record in records)]
    records = [replace(record, values=record.values[:, present]) for record in records]
    named = _conditions(records, model, [known[k] for k in present])
    grouped = [
        replace(record, group=group) for record, group in zip(named, group_numbers(named), strict=True)
    ]
    outputs = tuple(known[k] for k in present)
    if any(run.info["rows"] for run in runs):
        left_out += _unrecorded([name for name in known if name not in outputs])
    measured = Measurements(
        outputs=outputs,
        units=tuple(_unit(model, rig, name) for name in outputs),
        inputs=tuple(item.name for item in model.family.inputs),
        records=tuple(grouped),
        rig=rig,
        runs=tuple(run.id for run in runs),
        notes=(*left_out, *notes(grouped, outputs)),
    )
    return as_table(measured, runs, titles(model.family.name))


def _of_run(
    model: Model, run: Run, rig: Rig | None, outputs: Sequence[str], every: int
) -> list[MeasuredRecord]:
    if rig is None:
        raise RigctlError(
            f"the model '{model.name}' names no rig, so that commands and channels cannot be told",
            hint="Add 'rig: …' to the model file",
        )
    given = {name: value for name, value in model.values.items() if name in _input_names(model)}
    sources = input_sources(model.family, rig, given)
    _require_commands(model, run, rig, sources)
    units = [_input_unit(source, rig) for source in sources]
    return [
        _measured(model, run, _thinned(record, every), sources, units, outputs)
        for record in run.each(run.usable)
        if record.time.size >= _FEWEST_SAMPLES
    ]


def _thinned(record: Record, every: int) -> Record:
    """The record at every so many of its samples: picked, for an average would blur what jumps."""
    step = min(every, record.time.size // _LEAST_OF_A_RECORD)
    if step <= 1:
        return record
    return replace(
        record,
        time=record.time[::step],
        channels={name: values[::step] for name, values in record.channels.items()},
        commands={name: values[::step] for name, values in record.commands.items()},
    )


def _thinned_note(every: int) -> list[str]:
    if every <= 1:
        return []
    return [
        f"more than {_MOST_SAMPLES} samples: one in {every} is looked at, of no record fewer than "
        f"{_LEAST_OF_A_RECORD}"
    ]


def _input_names(model: Model) -> set[str]:
    return {item.name for item in model.family.inputs}


def _measured(
    model: Model,
    run: Run,
    record: Record,
    sources: Sequence[InputSource],
    units: Sequence[str],
    outputs: Sequence[str],
) -> MeasuredRecord:
    origin = float(record.time[0])
    times, half, rows = _commands(record, sources, origin)
    inputs = np.array([[source.of(row) for source in sources] for row in rows])
    for place, source in enumerate(sources):
        if source.channel is not None and source.channel in record.channels:
            inputs[:, place] = _typical(record.channels[source.channel], source.value)
    samples = record.time - origin
    nothing = np.full(samples.size, np.nan)
    phase, names = phases_of(samples, times, inputs, model.family, units)
    return MeasuredRecord(
        run=run.id,
        index=record.index,
        label=f"{run.id}/{record.index}",
        times=samples,
        switch_times=times,
        switch_half=half,
        inputs=inputs,
        values=np.column_stack([record.channels.get(name, nothing) for name in outputs]),
        condition=dict(record.sweep),
        group=0,
        phase=phase,
        phases=names,
    )


def _typical(values: np.ndarray, otherwise: float) -> float:
    present = values[np.isfinite(values)]
    return float(np.median(present)) if present.size else otherwise


def _commands(
    record: Record, sources: Sequence[InputSource], origin: float
) -> tuple[np.ndarray, np.ndarray, list[dict[str, float]]]:
    """(times from the first sample, half-widths, actuators' values): the first at the first sample.

    A command given at the moment of the first sample holds from there on, whatever that sample says; what
    is given at one moment is one command. A rig's commands that were not recorded stay at 0.
    """
    used = {name for source in sources for name, _ in source.actuators}
    now = dict.fromkeys(used, 0.0)
    for name in used & set(record.commands):
        present = record.commands[name][np.isfinite(record.commands[name])]
        now[name] = float(present[0]) if present.size else 0.0
    times, half, rows = [0.0], [0.0], [dict(now)]
    last = float(record.time[-1])
    for switch in sorted(record.switches, key=lambda one: one.time):
        if switch.actuator not in used or not origin <= switch.time <= last:
            continue
        now[switch.actuator] = switch.value
        if switch.time == origin:
            rows[0] = dict(now)
        elif switch.time - origin == times[-1]:
            half[-1] = max(half[-1], switch.uncertainty)
            rows[-1] = dict(now)
        elif rows[-1] != now:
            times.append(switch.time - origin)
            half.append(switch.uncertainty)
            rows.append(dict(now))
    return np.array(times), np.array(half), rows


def _input_unit(source: InputSource, rig: Rig) -> str:
    names = [name for name, _ in source.actuators]
    return rig.actuators[names[0]].display_unit if len(names) == 1 else ""


def _unit(model: Model, rig: Rig | None, output: str) -> str:
    if rig is not None and output in rig.channels:
        return rig.channels[output].unit
    return next(item.unit for item in model.family.outputs if item.name == output)


def _require_channels(model: Model, runs: Sequence[Run], known: Sequence[str]) -> None:
    """Samples with a channel that the model predicts; a table is judged by its own columns."""
    recorded = dict.fromkeys(name for run in runs for name in run.layout.channels)
    if all(run.info["rows"] for run in runs) and not any(name in known for name in recorded):
        raise RigctlError(
            f"{_ids(runs)} has no channel that the model '{model.name}' predicts",
            value=", ".join(recorded) or "none",
            expected=f"one of {', '.join(output.name for output in model.family.outputs)}",
        )


def _require_commands(model: Model, run: Run, rig: Rig, sources: Sequence[InputSource]) -> None:
    """What was commanded must be known: a valve that is taken as shut would look like missing physics.

    Heaters that no column tells of are off.
    """
    heat = {item.name for item in model.family.inputs if item.role == "heat"}
    wanted = [name for source in sources if source.input not in heat for name, _ in source.actuators]
    absent = [name for name in dict.fromkeys(wanted) if name not in run.layout.commands]
    if absent:
        columns = " and ".join(f"'{name} [{rig.actuators[name].display_unit}]'" for name in absent)
        raise RigctlError(
            f"{run.id} does not tell {' and '.join(absent)}, which the model '{model.name}' needs",
            value=", ".join(run.layout.commands) or "no command at all",
            expected=f"{columns} too",
            hint="'rigctl import' the file with it",
        )


def _require_records(records: Sequence[MeasuredRecord], runs: Sequence[Run]) -> None:
    if not records:
        every = sum(int(run.info["records"]) for run in runs)
        usable = sum(len(run.usable) for run in runs)
        raise RigctlError(
            f"no record of {_ids(runs)} can be used: of {_count(every, 'record')} {every - usable} are "
            f"incomplete or excluded, and {usable} have no value or fewer than {_FEWEST_SAMPLES} samples",
            hint="'rigctl runs show' lists them",
        )
    if not any(record.here.any() for record in records):
        raise RigctlError(f"{_ids(runs)} has no value in any channel that the model predicts")


def _too_short(run: Run, used: int) -> list[str]:
    count = len(run.usable) - used
    return (
        []
        if not count
        else [f"{_count(count, 'record')} of {run.id} left out: fewer than {_FEWEST_SAMPLES} samples"]
    )


def _unrecorded(names: Sequence[str]) -> list[str]:
    if not names:
        return []
    return [
        f"not recorded: {', '.join(names)}; the model is judged without {'it' if len(names) == 1 else 'them'}"
    ]


def _ids(runs: Sequence[Run]) -> str:
    return ", ".join(run.id for run in runs)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _conditions(
    records: Sequence[MeasuredRecord], model: Model, outputs: Sequence[str]
) -> list[MeasuredRecord]:
    """Records that no sweep tells apart are told apart by what was commanded, and where they began."""
    if len({tuple(sorted(record.condition.items())) for record in records}) > 1:
        return list(records)
    named = []
    for record in records:
        extra = {
            item.name: float(record.inputs[:, k][np.argmax(np.abs(record.inputs[:, k]))])
            for k, item in enumerate(model.family.inputs)
        }
        first = next((c for c in range(len(outputs)) if record.here[:, c].any()), None)
        if first is not None and record.times.size > 1:
            extra[f"{START}{outputs[first]}"] = first_reading(record, first)
        named.append(replace(record, condition={**record.condition, **extra}))
    differing = {name for name in named[0].condition if len({record.condition[name] for record in named}) > 1}
    return [
        replace(
            record, condition={name: record.condition[name] for name in record.condition if name in differing}
        )
        for record in named
    ]


def condition_text(condition: Mapping[str, float], units: Mapping[str, str]) -> str:
    """A condition in words: ``oil 40 degC, supply 30 bar``."""
    from rigctl.units import show

    return ", ".join(
        f"{name} {show(value, units[name])}" for name, value in condition.items() if name in units
    )
