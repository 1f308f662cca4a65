"""A table of single values: its units, redundant columns, and the variable by which it is ordered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.dataset.run import Run
from rigctl.model.measured.note import as_notes
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.noise import same_reading

Floats = NDArray[np.float64]


def as_table(
    measurements: Measurements, runs: Sequence[Run], named: Mapping[str, str] | None = None
) -> Measurements:
    """Rows with the units of their file, without columns that were computed from another one.

    `named` are the columns from which outputs were read if their names differ. A column with the same scatter
    as another adds no information; counted twice, every misfit would seem more significant than it is.
    Measurements over time are returned unchanged.
    """
    if not measurements.table:
        return measurements
    columns = {name: unit for run in runs for name, unit in run.record_units.items()}
    titles = {output: name for output, name in (named or {}).items() if name in columns}
    units = tuple(
        columns.get(titles.get(name, name), unit)
        for name, unit in zip(measurements.outputs, measurements.units, strict=True)
    )
    table = replace(measurements, units=units, columns=columns, titles=titles)
    # in order of the outputs: of two columns that scatter alike the first is kept, and the other remains
    # beside it for the reader
    points, series = curves(table)
    kept: list[int] = []
    notes: list[str] = []
    for index, name in enumerate(table.outputs):
        values = column(table, index)
        source = next((k for k in kept if same_reading(column(table, k), values, points, series)), None)
        if source is None:
            kept.append(index)
        else:
            notes.append(
                f"{name} scatters exactly as {table.outputs[source]} does: it was computed from it, adds no "
                "information, and counts in no fit and no test"
            )
    return _only_columns(table, kept, notes)


def column(measurements: Measurements, index: int) -> Floats:
    """(rows) SI, readings of one output: the last reading of each row, NaN if there is none."""
    return np.array([_last(record, index) for record in measurements.records])


def _last(record: MeasuredRecord, index: int) -> float:
    present = record.values[np.isfinite(record.values[:, index]), index]
    return float(present[-1]) if present.size else float("nan")


def curves(measurements: Measurements, but: str = "") -> tuple[Floats, NDArray[np.intp]]:
    """(rows) the variable by which the rows are ordered, and the number of the curve on which each lies.

    It is the operating variable with the most different values, except `but`; rows that agree in all others
    lie on one curve. If nothing differs all are at one point.
    """
    # the variable with the most values is what was swept, the others tell one sweep from the next
    over = curve_variable(measurements, but)
    records = measurements.records
    if over is None:
        return np.zeros(len(records)), np.zeros(len(records), dtype=np.intp)
    points = np.array([record.condition.get(over, np.nan) for record in records])
    others = [name for name in measurements.variables if name != over]
    numbers: dict[tuple[str, ...], int] = {}
    series = [
        numbers.setdefault(
            tuple(f"{record.condition.get(name, np.nan):.5g}" for name in others), len(numbers)
        )
        for record in records
    ]
    return points, np.array(series, dtype=np.intp)


def curve_variable(measurements: Measurements, but: str = "") -> str | None:
    """The operating variable with the most different values, the first of them; None if none differs."""
    names = [name for name in measurements.variables if name != but]
    counts = {name: len({record.condition.get(name) for record in measurements.records}) for name in names}
    return max(names, key=lambda name: counts[name], default=None)


def set_variable(measurements: Measurements) -> str:
    """The operating variable that is set by hand for each row, such as the pressure; "" if none is."""
    rig = measurements.rig
    role = rig.roles.set_pressure if rig is not None else None
    if role is None:
        return ""
    return next((name for name in (role.actuator, role.channel) if name in measurements.variables), "")


def _only_columns(measurements: Measurements, kept: Sequence[int], notes: Sequence[str]) -> Measurements:
    if len(kept) == len(measurements.outputs):
        return measurements
    records = tuple(
        replace(
            record,
            values=record.values[:, kept],
            beside={
                **record.beside,
                **{
                    name: _last(record, index)
                    for index, name in enumerate(measurements.outputs)
                    if index not in kept
                },
            },
        )
        for record in measurements.records
    )
    return replace(
        measurements,
        outputs=tuple(measurements.outputs[index] for index in kept),
        units=tuple(measurements.units[index] for index in kept),
        records=records,
        notes=(*measurements.notes, *as_notes(notes)),
    )
