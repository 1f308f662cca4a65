"""Tables without time: one value for each condition.

Of a family without motion the rows become one record, a row a second, as its standard record has it. Of a
family that moves a row is a record: the standard record at the row's condition, of which only the value that
was written down is known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.dataset.run import Record, Run
from rigctl.errors import RigctlError
from rigctl.model.inputs import input_sources
from rigctl.model.measured.record import MeasuredRecord
from rigctl.model.model import Model
from rigctl.physics.standard_record import StandardRecord
from rigctl.rig.rig import Rig

#: what a table's column says of a family that moves: the output it is of, and where the family's standard
#: record shows it (s)
_MEASURES = {"hydraulic_cylinder": {"stroke": ("position", 2.2)}}


def observed_records(model: Model, run: Run, rig: Rig | None, outputs: Sequence[str]) -> list[MeasuredRecord]:
    """The rows of a table as records of `model`.

    Raises
    ------
    RigctlError
        the table has no column that the model predicts.
    """
    rows = [run.record(index) for index in run.usable]
    if model.family.states and not _is_static(model):
        return [found for row in rows if (found := _moving(model, run, row, rig, outputs)) is not None]
    return [_table(model, run, rows, outputs)]


def _is_static(model: Model) -> bool:
    """A family whose only state counts the rows of a table."""
    return [state.name for state in model.family.states] == ["row"]


def _values(row: Record) -> dict[str, float]:
    return {**row.sweep, **row.measures}


def _table(model: Model, run: Run, rows: Sequence[Record], outputs: Sequence[str]) -> MeasuredRecord:
    names = [item.name for item in model.family.inputs]
    usual = {item.name: model.values.get(item.name, item.value) for item in model.family.inputs}
    known = [_values(row) for row in rows]
    values = np.array([[row.get(name, np.nan) for name in outputs] for row in known]).reshape(
        -1, len(outputs)
    )
    if not rows or not np.isfinite(values).any():
        found = ", ".join(dict.fromkeys(name for row in known for name in row)) or "nothing"
        raise RigctlError(
            f"{run.id} has no column that the model predicts", value=found, expected=" or ".join(outputs)
        )
    count = len(rows)
    return MeasuredRecord(
        run=run.id,
        index=0,
        label=run.id,
        times=np.arange(count, dtype=np.float64) + 0.5,
        switch_times=np.arange(count, dtype=float),
        switch_half=np.zeros(count),
        inputs=np.array([[row.get(name, usual[name]) for name in names] for row in known]),
        values=values,
        condition={},
        group=0,
        phase=np.arange(count, dtype=np.intp),
        phases=tuple(row.path or f"row {row.index + 1}" for row in rows),
    )


def _moving(
    model: Model, run: Run, row: Record, rig: Rig | None, outputs: Sequence[str]
) -> MeasuredRecord | None:
    standard = model.family.standard_record
    known = _values(row)
    measures = _MEASURES.get(model.family.name, {})
    found = {name: place for name, place in measures.items() if name in known}
    if standard is None or rig is None or not found:
        return None
    times = sorted({time for _, time in found.values()})
    values = np.full((len(times), len(outputs)), np.nan)
    for name, (output, time) in found.items():
        if output in outputs:
            values[times.index(time), list(outputs).index(output)] = known[name]
    switch_times, inputs = _commanded(model, rig, row, standard)
    return MeasuredRecord(
        run=run.id,
        index=row.index,
        label=f"{run.id}/{row.index + 1}",
        times=np.array(times),
        switch_times=switch_times,
        switch_half=np.zeros(switch_times.size),
        inputs=inputs,
        values=values,
        condition=dict(row.sweep),
        group=0,
        phase=np.zeros(len(times), dtype=np.intp),
        phases=("hold",),
    )


def _commanded(
    model: Model, rig: Rig, row: Record, standard: StandardRecord
) -> tuple[np.ndarray, np.ndarray]:
    """The standard record's commands, with the row's own set-points instead of the record's."""
    names = [item.name for item in model.family.inputs]
    own = {}
    for source in input_sources(model.family, rig):
        for actuator, factor in source.actuators:
            if actuator in row.sweep:
                own[source.input] = factor * row.sweep[actuator]
    role = rig.roles.set_pressure
    if role is not None and role.channel in row.sweep:
        own.setdefault("pressure_setpoint", row.sweep[role.channel])
    now = {item.name: item.value for item in model.family.inputs}
    rows = []
    for _, changed in standard.switches:
        now |= dict(changed)
        rows.append([{**now, **own}[name] for name in names])
    return np.array([time for time, _ in standard.switches]), np.array(rows)
