"""Runs as measurements for a model: its inputs from commands, its outputs from channels.

In: a model, and runs of its bench. Out: `Measurements`, the one form in which fits, tests and designs see
data: in SI, in the model's order of inputs and outputs, with the uncertainty of sensors and clocks, and with
a note on whatever was left out, assumed or smoothed. The order of the steps is that of `read_measurements`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigctl.dataset.run import Record, Run
from rigctl.errors import RigctlError
from rigctl.model.inputs import InputSource, input_sources
from rigctl.model.measured.assumed import assumed_notes, assumed_of
from rigctl.model.measured.clocks import clock_notes, require_long_records
from rigctl.model.measured.conditions import with_conditions
from rigctl.model.measured.excitation import (
    Acting,
    acting,
    actuator_range,
    unrecorded_actuators,
    with_stated_values,
)
from rigctl.model.measured.groups import group_numbers
from rigctl.model.measured.input_notes import acting_notes, steady_inputs, taken_notes
from rigctl.model.measured.note import Note, as_notes
from rigctl.model.measured.notes import notes
from rigctl.model.measured.observations import observed_records, taken_inputs, taken_temperature, titles
from rigctl.model.measured.offsets import as_taken, moved_lines, stated_offsets
from rigctl.model.measured.phases import phases_of
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.measured.rigs import recorded_rigs, rig_of
from rigctl.model.measured.stuck import without_stuck_readings
from rigctl.model.measured.table import as_table
from rigctl.model.model import Model
from rigctl.model.reading_errors import ReadingError, calibration_errors, clock_errors
from rigctl.rig.rig import Rig
from rigctl.units import show
from rigctl.wording import number_of

#: least number of samples of a record
_FEWEST_SAMPLES = 5
#: with more samples than this, a subset is used, but never fewer per record than the second number
_MOST_SAMPLES, _LEAST_OF_A_RECORD = 500_000, 400


def read_measurements(model: Model, runs: Sequence[Run]) -> Measurements:
    """The usable records of `runs`, as inputs and measured outputs of `model`.

    Raises
    ------
    RigctlError
        a run belongs to another rig, has none of the model's channels, no command of the model's, or no
        usable record.
    """
    # 1. the bench, as it was when each run was recorded, and the channels of it that the model predicts
    rig = rig_of(model, runs)
    rigs = recorded_rigs(model, runs)
    known = [output.name for output in model.family.outputs if rig is None or output.name in rig.channels]
    _require_channels(model, runs, known)
    records: list[MeasuredRecord] = []
    # 2. records, of runs over time and of tables; very long ones are subsampled (decision 15)
    every = -(-sum(int(run.info["rows"]) for run in runs) // _MOST_SAMPLES)
    left_out: list[str | Note] = [*_thinned_note(every)]
    acts: list[Acting] = []
    for run in runs:
        if run.info["rows"]:
            late = stated_offsets(rigs[run.id].clocks) if run.id in rigs else {}
            of_run = _of_run(model, run, rig, known, every, late)
            left_out += [*_too_short(run, len(of_run)), *assumed_notes(model, run, rig)]
            records += [record for record, _ in of_run]
            acts += [one for _, one in of_run]
        else:
            left_out += [
                *assumed_notes(model, run, rig),
                *taken_notes(model, rig, taken_inputs(model, run, rig)),
                *_temperature_note(taken_temperature(model, run, rig)),
            ]
            records += observed_records(model, run, rig, known)
    _require_records(records, runs)
    # 3. what no record has is no output; then the condition of each record, and with it the groups of
    # replicates
    present = [k for k in range(len(known)) if any(record.here[:, k].any() for record in records)]
    records = [replace(record, values=record.values[:, present]) for record in records]
    named = with_conditions(records, model, [known[k] for k in present])
    grouped = [
        replace(record, group=group) for record, group in zip(named, group_numbers(named), strict=True)
    ]
    # 4. noise is taken out of measured inputs, and what a stuck sensor repeated is no reading
    steady = steady_inputs(model, rig, grouped)
    outputs = tuple(known[k] for k in present)
    if any(run.info["rows"] for run in runs):
        left_out += _unrecorded([name for name in known if name not in outputs])
    units = tuple(_unit(model, rig, name) for name in outputs)
    used, stuck = without_stuck_readings(steady.records, outputs, units, rig)
    measured = Measurements(
        outputs=outputs,
        units=units,
        inputs=tuple(item.name for item in model.family.inputs),
        records=tuple(used),
        rig=rig,
        runs=tuple(run.id for run in runs),
        notes=as_notes(
            (
                *left_out,
                *acting_notes(model, rig, grouped, acts),
                *steady.notes,
                *notes(grouped, outputs),
                *stuck,
            )
        ),
        input_noise=steady.noise,
    )
    # 5. how wrong sensors and clocks may be, last: a gain is stated over the span of the readings that count.
    # What is known of their errors becomes unknowns, a bare uncertainty does not
    table = as_table(measured, runs, titles(model.family))
    errors = _reading_errors(table, runs, rigs)
    uncertain = replace(
        table,
        reading_errors=tuple(one for one in errors if one.known),
        possible_errors=tuple(one for one in errors if not one.known),
    )
    require_long_records(uncertain)
    return replace(uncertain, notes=(*uncertain.notes, *as_notes(clock_notes(uncertain))))


def _reading_errors(
    measured: Measurements, runs: Sequence[Run], rigs: Mapping[str, Rig]
) -> tuple[ReadingError, ...]:
    """How wrong calibrations and clocks may be: of the outputs, and of the inputs that a channel measured."""
    if measured.rig is None or not measured.records:
        return ()
    records = measured.records
    inputs = {name for run in runs if run.id in rigs for name in run.layout.channels}
    readings = {
        name: np.concatenate([record.values[:, k] for record in records])
        for k, name in enumerate(measured.outputs)
    }
    readings |= {
        name: np.concatenate([record.input_course(k) for record in records])
        for k, name in enumerate(measured.inputs)
        if name in inputs
    }
    channels = {run: rig.channels for run, rig in rigs.items()}
    clocks = {} if measured.table else {run: rig.clocks for run, rig in rigs.items()}
    return (
        *calibration_errors(channels, readings, rows=measured.table),
        *clock_errors(clocks, readings),
    )


def _of_run(
    model: Model,
    run: Run,
    rig: Rig | None,
    outputs: Sequence[str],
    every: int,
    late: Mapping[str, float],
) -> list[tuple[MeasuredRecord, Acting]]:
    if rig is None:
        raise RigctlError(
            f"the model '{model.name}' names no rig, so that commands and channels cannot be told",
            hint="Add 'rig: …' to the model file",
        )
    # the user's words override the record, the record overrides the model file, and that the family
    given = {name: value for name, value in model.values.items() if name in _input_names(model)}
    every_source = input_sources(model.family, rig, given)
    units = [_input_unit(source, rig) for source in every_source]
    sources = with_stated_values(every_source, assumed_of(run))
    _require_commands(model, run, rig, sources)
    records = []
    for record in run.each(run.usable):
        if record.time.size >= _FEWEST_SAMPLES:
            # lines are those of all samples: a subset of a fast input would be a different one
            acts = acting(record, run, rig, sources)
            picked = _thinned(record, every)
            knots = record.time - float(record.time[0])
            records.append((_measured(model, run, picked, acts, knots, units, outputs, late), acts))
    return records


def _thinned(record: Record, every: int) -> Record:
    """The record at every n-th sample: selected, because averages would blur jumps."""
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
    acts: Acting,
    knots: np.ndarray,
    units: Sequence[str],
    outputs: Sequence[str],
    late: Mapping[str, float],
) -> MeasuredRecord:
    label = f"{run.id}/{record.index}"
    nothing = np.full(record.time.size, np.nan)
    # times as the clocks were, by what the rig file states of them: of the readings here, of measured inputs
    # below; what is left of an offset is an unknown (`reading_errors`)
    samples, values = as_taken(
        record.time - float(record.time[0]),
        np.column_stack([record.channels.get(name, nothing) for name in outputs]),
        [late.get(name, 0.0) for name in outputs],
        label,
    )
    inputs = [item.name for item in model.family.inputs]
    knots, lines = moved_lines(knots, acts.lines, [late.get(inputs[k], 0.0) for k in acts.along])
    phase, names = phases_of(samples, acts.times, acts.commanded, model.family, units)
    return MeasuredRecord(
        run=run.id,
        index=record.index,
        label=label,
        times=samples,
        switch_times=acts.times,
        switch_half=acts.half,
        switch_jitter=acts.jitter,
        inputs=acts.rows,
        values=values,
        condition=dict(record.sweep),
        group=0,
        phase=phase,
        phases=names,
        along=acts.along,
        knots=knots,
        lines=lines,
        unrecorded=acts.unrecorded,
    )


def _input_unit(source: InputSource, rig: Rig) -> str:
    names = [name for name, _ in source.actuators]
    return rig.actuators[names[0]].display_unit if len(names) == 1 else ""


def _unit(model: Model, rig: Rig | None, output: str) -> str:
    if rig is not None and output in rig.channels:
        return rig.channels[output].unit
    return {item.name: item.unit for item in model.family.outputs}[output]


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
    """What moves or drives the bench must be known: no prior can replace it.

    A further input that was not recorded is an unknown of each record, if the rig states its range; so is a
    heater, even alone.
    """
    roles = {item.name: item.role for item in model.family.inputs}
    wanted: list[str] = []
    commanded = [source for source in sources if source.actuators]
    # wanted are every command with a role of its own except a heater's, at least one of the others, and
    # whatever has no range to be unknown within
    nothing = all(unrecorded_actuators(one, run) for one in commanded if roles[one.input] != "heat")
    for source in commanded:
        absent = unrecorded_actuators(source, run)
        low_high = [actuator_range(rig.actuators[name]) for name in absent]
        ranged = all(np.isfinite(low) and np.isfinite(high) for low, high in low_high)
        drives = roles[source.input] != "heat" and (nothing or roles[source.input] is not None)
        if drives or not ranged:
            wanted += absent
    absent = list(dict.fromkeys(wanted))
    if absent:
        columns = " and ".join(f"'{name} [{rig.actuators[name].display_unit}]'" for name in absent)
        raise RigctlError(
            f"{run.id} has no record of {' and '.join(absent)}, which the model '{model.name}' needs",
            value=", ".join(run.layout.commands) or "no command at all",
            expected=f"{columns} too",
            hint=f"'rigctl import' the file with it, or say what it was: '--assume {absent[0]}=…'",
        )


def _require_records(records: Sequence[MeasuredRecord], runs: Sequence[Run]) -> None:
    if not records:
        every = sum(int(run.info["records"]) for run in runs)
        usable = sum(len(run.usable) for run in runs)
        raise RigctlError(
            f"no record of {_ids(runs)} can be used: of {number_of(every, 'record')} {every - usable} are "
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
        else [f"{number_of(count, 'record')} of {run.id} left out: fewer than {_FEWEST_SAMPLES} samples"]
    )


def _temperature_note(taken: float | None) -> list[str]:
    if taken is None:
        return []
    return [
        f"not recorded: oil_temperature; taken as {show(taken, 'degC')} in rows without it, a column of that "
        "name says otherwise"
    ]


def _unrecorded(names: Sequence[str]) -> list[str]:
    if not names:
        return []
    return [
        f"not recorded: {', '.join(names)}; the model is judged without {'it' if len(names) == 1 else 'them'}"
    ]


def _ids(runs: Sequence[Run]) -> str:
    return ", ".join(run.id for run in runs)
