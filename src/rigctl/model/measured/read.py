"""Runs as measurements for a model: which commands were its inputs, which channels its outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigctl.dataset.run import Record, Run
from rigctl.errors import RigctlError
from rigctl.model.inputs import InputSource, input_sources
from rigctl.model.measured.groups import first_reading, group_numbers
from rigctl.model.measured.observations import observed_records
from rigctl.model.measured.phases import phases_of
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.measured.rigs import rig_of
from rigctl.model.model import Model
from rigctl.rig.rig import Rig

#: a record with fewer samples tells nothing of a motion
_FEWEST_SAMPLES = 5
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
    records: list[MeasuredRecord] = []
    for run in runs:
        if run.info["rows"]:
            records += _of_run(model, run, rig, known)
        else:
            records += observed_records(model, run, rig, known)
    _check(records, known, runs, model)
    present = [k for k in range(len(known)) if any(record.here[:, k].any() for record in records)]
    records = [replace(record, values=record.values[:, present]) for record in records]
    named = _conditions(records, model, [known[k] for k in present])
    grouped = [
        replace(record, group=group) for record, group in zip(named, group_numbers(named), strict=True)
    ]
    outputs = tuple(known[k] for k in present)
    return Measurements(
        outputs=outputs,
        units=tuple(_unit(model, rig, name) for name in outputs),
        inputs=tuple(item.name for item in model.family.inputs),
        records=tuple(grouped),
        rig=rig,
        runs=tuple(run.id for run in runs),
        notes=tuple(_notes(grouped, outputs)),
    )


def _of_run(model: Model, run: Run, rig: Rig | None, outputs: Sequence[str]) -> list[MeasuredRecord]:
    if rig is None:
        raise RigctlError(
            f"the model '{model.name}' names no rig, so that commands and channels cannot be told",
            hint="Add 'rig: …' to the model file",
        )
    given = {name: value for name, value in model.values.items() if name in _input_names(model)}
    sources = input_sources(model.family, rig, given)
    units = [_input_unit(source, rig) for source in sources]
    found = []
    for index in run.usable:
        record = run.record(index)
        if record.time.size >= _FEWEST_SAMPLES:
            found.append(_measured(model, run, record, sources, units, outputs))
    return found


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
        label=f"{run.id}/{record.index + 1}",
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

    A rig's commands that were not recorded stay at 0.
    """
    used = {name for source in sources for name, _ in source.actuators}
    now = dict.fromkeys(used, 0.0)
    for name in used & set(record.commands):
        present = record.commands[name][np.isfinite(record.commands[name])]
        now[name] = float(present[0]) if present.size else 0.0
    times, half, rows = [0.0], [0.0], [dict(now)]
    last = float(record.time[-1])
    for switch in sorted(record.switches, key=lambda one: one.time):
        if switch.actuator not in used or not origin < switch.time <= last:
            continue
        now[switch.actuator] = switch.value
        if rows[-1] != now:
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


def _check(
    records: Sequence[MeasuredRecord], known: Sequence[str], runs: Sequence[Run], model: Model
) -> None:
    which = ", ".join(run.id for run in runs)
    if not records:
        raise RigctlError(
            f"no record of {which} can be used: each is incomplete, excluded, or shorter than "
            f"{_FEWEST_SAMPLES} samples",
            hint="'rigctl runs show' tells why",
        )
    if not known or not any(record.here.any() for record in records):
        outputs = ", ".join(output.name for output in model.family.outputs)
        raise RigctlError(f"{which} has no channel that the model predicts", expected=f"one of {outputs}")


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


def _notes(records: Sequence[MeasuredRecord], outputs: Sequence[str]) -> list[str]:
    found = []
    half = max((float(record.switch_half.max(initial=0.0)) for record in records), default=0.0)
    if half > 0.0:
        found.append(
            f"Commands were written down with the samples: their times are known to ±{1e3 * half:.3g} ms"
        )
    for place, name in enumerate(outputs):
        missing = sum(int((~record.here[:, place]).sum()) for record in records)
        if missing:
            total = sum(record.times.size for record in records)
            found.append(f"{name} is missing in {missing} of {total} samples")
        constant = [
            record.label for record in records if _constant(record.values[:, place]) and record.times.size > 1
        ]
        if constant and len(constant) == len(records) and _same_everywhere(records, place):
            found.append(f"{name} never changes: the sensor may be dead, or the channel is not connected")
    return found


def _constant(values: np.ndarray) -> bool:
    present = values[np.isfinite(values)]
    return bool(present.size and np.ptp(present) == 0.0)


def _same_everywhere(records: Sequence[MeasuredRecord], place: int) -> bool:
    every: set[float] = set()
    for record in records:
        every |= set(record.values[record.here[:, place], place][:2].tolist())
    return len(every) == 1


def condition_text(condition: Mapping[str, float], units: Mapping[str, str]) -> str:
    """A condition in words: ``oil 40 degC, supply 30 bar``."""
    from rigctl.units import show

    return ", ".join(
        f"{name} {show(value, units[name])}" for name, value in condition.items() if name in units
    )
