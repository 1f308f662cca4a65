"""A table of single values: its units, columns that say the same, and the variable it is over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.dataset.run import Run
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.noise import same_reading

Floats = NDArray[np.float64]


def as_table(
    measurements: Measurements, runs: Sequence[Run], named: Mapping[str, str] | None = None
) -> Measurements:
    """Rows with the units of their file, and without columns that were worked out from another one.

    `named` are the columns that outputs were read from where these have other names. A column whose scatter
    is that of another says nothing new; counted twice, every misfit would seem surer than it is. Measurements
    with a course in time are returned as they are.
    """
    if not measurements.table:
        return measurements
    columns = {name: unit for run in runs for name, unit in run.record_units.items()}
    titles = {output: name for output, name in (named or {}).items() if name in columns}
    units = tuple(
        columns.get(titles.get(name, name), unit)
        for name, unit in zip(measurements.outputs, measurements.units, strict=True)
    )
    found = replace(measurements, units=units, columns=columns, titles=titles)
    points, series = curves(found)
    kept: list[int] = []
    notes: list[str] = []
    for index, name in enumerate(found.outputs):
        values = column(found, index)
        source = next((k for k in kept if same_reading(column(found, k), values, points, series)), None)
        if source is None:
            kept.append(index)
        else:
            notes.append(
                f"{name} scatters exactly as {found.outputs[source]} does: it was worked out from it, says "
                "nothing new, and counts in no fit and no test"
            )
    return _only_columns(found, kept, notes)


def column(measurements: Measurements, index: int) -> Floats:
    """(rows) SI, what was read of one output: the last reading of each row, NaN where there is none."""
    return np.array([_last(record, index) for record in measurements.records])


def _last(record: MeasuredRecord, index: int) -> float:
    present = record.values[np.isfinite(record.values[:, index]), index]
    return float(present[-1]) if present.size else float("nan")


def curves(measurements: Measurements, but: str = "") -> tuple[Floats, NDArray[np.intp]]:
    """(rows) what the rows are ordered by, and the number of the curve on which each lies.

    That is the operating variable with the most different values, `but` left out; rows that agree in all
    others lie on one curve. Where nothing differs all are at one point.
    """
    over = curve_variable(measurements, but)
    records = measurements.records
    if over is None:
        return np.zeros(len(records)), np.zeros(len(records), dtype=np.intp)
    points = np.array([record.condition.get(over, np.nan) for record in records])
    others = [name for name in measurements.variables if name != over]
    seen: dict[tuple[str, ...], int] = {}
    series = [
        seen.setdefault(tuple(f"{record.condition.get(name, np.nan):.5g}" for name in others), len(seen))
        for record in records
    ]
    return points, np.array(series, dtype=np.intp)


def curve_variable(measurements: Measurements, but: str = "") -> str | None:
    """The operating variable with the most different values, the first of them; None where none differs."""
    names = [name for name in measurements.variables if name != but]
    counts = {name: len({record.condition.get(name) for record in measurements.records}) for name in names}
    return max(names, key=lambda name: counts[name], default=None)


def set_variable(measurements: Measurements) -> str:
    """The operating variable that is set by hand for each row, as the pressure is; "" where none is."""
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
        notes=(*measurements.notes, *notes),
    )
