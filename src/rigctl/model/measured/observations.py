"""Tables without time: a row holds the readings at one operating point, and becomes a record of one instant.

For a family that moves, it is the standard record at the row's operating point, of which only the recorded
value is known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigctl.dataset.run import Record, Run
from rigctl.errors import RigctlError
from rigctl.model.inputs import input_sources
from rigctl.model.measured.assumed import assumed_of
from rigctl.model.measured.excitation import unknown_range, with_stated_values
from rigctl.model.measured.record import MeasuredRecord
from rigctl.model.model import Model
from rigctl.physics.family import ModelFamily
from rigctl.physics.standard_record import StandardRecord
from rigctl.rig.common_names import on_rig
from rigctl.rig.rig import Rig

#: the state that a row's operating point sets, by the name of its column
_OIL = "oil_temperature"


def titles(family: ModelFamily) -> dict[str, str]:
    """The column of a table from which each output of a family is read, if its name differs."""
    return {output: column for column, (output, _) in family.single_values.items()}


def observed_records(model: Model, run: Run, rig: Rig | None, outputs: Sequence[str]) -> list[MeasuredRecord]:
    """The rows of a table with a reading, as records of `model`.

    Raises
    ------
    RigctlError
        the table has no column that the model predicts.
    """
    rows = _rows(run, rig)
    if model.family.states:
        moving = [
            observed for row in rows if (observed := _moving(model, run, row, rig, outputs)) is not None
        ]
        return [record for record in moving if record.here.any()]
    return [record for record in _table(model, run, rig, rows, outputs) if record.here.any()]


def _rows(run: Run, rig: Rig | None) -> list[Record]:
    """The usable rows with the rig's names of their set-points, which an import without it could not know."""
    rows = [run.record(index) for index in run.usable]
    if rig is None:
        return rows
    return [replace(row, sweep={on_rig(n, rig): value for n, value in row.sweep.items()}) for row in rows]


def taken_inputs(model: Model, run: Run, rig: Rig | None) -> dict[str, float]:
    """The inputs, SI, that are no column of a table without time and whose values are not given."""
    if run.info["rows"]:
        return {}
    if model.family.states:
        return _set_points_of_record(model, run, rig)
    known = {name for index in run.usable for name in _values(run.record(index))}
    values, spans, stated = _absent(model, run, rig)
    return {n: value for n, value in values.items() if n not in known and n not in spans and n not in stated}


def taken_temperature(model: Model, run: Run, rig: Rig | None) -> float | None:
    """The oil temperature, K, assumed for table rows without that column; None if no row lacks it."""
    start = {state.name: state.start for state in model.family.states}.get(_OIL)
    if start is None or run.info["rows"]:
        return None
    return None if all(_OIL in row.sweep for row in _rows(run, rig)) else start


def _set_points_of_record(model: Model, run: Run, rig: Rig | None) -> dict[str, float]:
    """The set-points, SI, that a family's standard record holds and neither a row nor the user gives.

    Its motion is what a row describes, and its heater hardly changes the oil temperature in so short a time.
    """
    # what the standard record sets at its start and never changes: a row is one such record, so these are the
    # only set-points that it can lack
    standard = model.family.standard_record
    if standard is None or rig is None:
        return {}
    held = dict(standard.switches[0][1])
    for _, changed in standard.switches[1:]:
        held = {name: value for name, value in held.items() if name not in changed}
    given = [_set_points(model, rig, run, row) for row in _rows(run, rig)]
    set_by_role = {item.name for item in model.family.inputs if item.role not in ("move", "heat")}
    known = {source.input for source in input_sources(model.family, rig) if source.said}
    return {
        name: value
        for name, value in held.items()
        if name in set_by_role - known and any(name not in one for one in given)
    }


def _absent(
    model: Model, run: Run, rig: Rig | None
) -> tuple[dict[str, float], dict[str, tuple[float, float]], set[str]]:
    """For every input its value if no column has it, its unknown range, and which are given."""
    given = {item.name: model.values[item.name] for item in model.family.inputs if item.name in model.values}
    if rig is None:
        values = {item.name: given.get(item.name, item.value) for item in model.family.inputs}
        return values | dict(assumed_of(run)), {}, {*given, *assumed_of(run)}
    sources = with_stated_values(input_sources(model.family, rig, given), assumed_of(run))
    ranges = {source.input: unknown_range(source, rig) for source in sources}
    usual = {item.name: item.value for item in model.family.inputs}
    return (
        {source.input: source.value if source.said else usual[source.input] for source in sources},
        {name: span for name, span in ranges.items() if span is not None},
        {source.input for source in sources if source.said},
    )


def _values(row: Record) -> dict[str, float]:
    return {**row.sweep, **row.measures}


def _table(
    model: Model, run: Run, rig: Rig | None, rows: Sequence[Record], outputs: Sequence[str]
) -> list[MeasuredRecord]:
    # an input with a column is taken from it, if only in some rows; one without is unknown within its range,
    # or has the value that the model gives
    values, spans, _ = _absent(model, run, rig)
    columns = {name for row in rows for name in _values(row)}
    spans = {name: span for name, span in spans.items() if name not in columns}
    records = [_still(run, row, {**values, **dict.fromkeys(spans, 0.0)}, spans, outputs) for row in rows]
    if not any(record.here.any() for record in records):
        names = ", ".join(dict.fromkeys(name for row in rows for name in _values(row))) or "nothing"
        raise RigctlError(
            f"{run.id} has no column that the model predicts", value=names, expected=" or ".join(outputs)
        )
    return records


def _still(
    run: Run,
    row: Record,
    inputs: Mapping[str, float],
    unrecorded: Mapping[str, tuple[float, float]],
    outputs: Sequence[str],
) -> MeasuredRecord:
    """A row of a family without motion: the inputs hold, and it is read after half a second."""
    known = _values(row)
    return MeasuredRecord(
        run=run.id,
        index=row.index,
        label=f"{run.id}/{row.index}",
        times=np.array([0.5]),
        switch_times=np.zeros(1),
        switch_half=np.zeros(1),
        inputs=np.array([[known.get(name, usual) for name, usual in inputs.items()]]),
        values=np.array([[known.get(name, np.nan) for name in outputs]]),
        condition={name: known[name] for name in inputs if name in known},
        group=0,
        phase=np.zeros(1, dtype=np.intp),
        phases=("row",),
        row=True,
        beside={name: value for name, value in row.measures.items() if name not in outputs},
        unrecorded=unrecorded,
    )


def _moving(
    model: Model, run: Run, row: Record, rig: Rig | None, outputs: Sequence[str]
) -> MeasuredRecord | None:
    standard = model.family.standard_record
    known = _values(row)
    readings = {name: read for name, read in model.family.single_values.items() if name in known}
    if standard is None or rig is None or not readings:
        return None
    # the standard record at this row's set-points, read at the instants that its columns stand for, and
    # nowhere else
    times = sorted({time for _, time in readings.values()})
    values = np.full((len(times), len(outputs)), np.nan)
    for name, (output, time) in readings.items():
        if output in outputs:
            values[times.index(time), list(outputs).index(output)] = known[name]
    switch_times, inputs = _commanded(model, _set_points(model, rig, run, row), standard)
    return MeasuredRecord(
        run=run.id,
        index=row.index,
        label=f"{run.id}/{row.index}",
        times=np.array(times),
        switch_times=switch_times,
        switch_half=np.zeros(switch_times.size),
        inputs=inputs,
        values=values,
        condition=dict(row.sweep),
        group=0,
        phase=np.zeros(len(times), dtype=np.intp),
        phases=("hold",),
        row=True,
        beside={name: value for name, value in row.measures.items() if name not in readings},
    )


def _set_points(model: Model, rig: Rig, run: Run, row: Record) -> dict[str, float]:
    """The inputs, SI, of which a row or the user gives the value."""
    assumed = assumed_of(run)
    inputs, commands = dict[str, float](), {**assumed, **row.sweep}
    for source in input_sources(model.family, rig):
        known = [(factor, commands[name]) for name, factor in source.actuators if name in commands]
        if known:
            inputs[source.input] = source.value + sum(factor * value for factor, value in known)
        elif source.input in assumed:
            inputs[source.input] = assumed[source.input]
    role = rig.roles.set_pressure
    if role is not None and role.channel in row.sweep:
        inputs.setdefault("pressure_setpoint", row.sweep[role.channel])
    return inputs


def _commanded(
    model: Model, set_points: Mapping[str, float], standard: StandardRecord
) -> tuple[np.ndarray, np.ndarray]:
    """The standard record's commands, with the row's own set-points instead of the record's."""
    names = [item.name for item in model.family.inputs]
    now = {item.name: item.value for item in model.family.inputs}
    rows = []
    for _, changed in standard.switches:
        now |= dict(changed)
        rows.append([{**now, **set_points}[name] for name in names])
    return np.array([time for time, _ in standard.switches]), np.array(rows)
