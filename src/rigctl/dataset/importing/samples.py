"""A table of samples, told apart into records, with the times at which commands were switched."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rigctl.dataset.importing.checks import BETWEEN, Stretch, find_faults, record_labels, stretches
from rigctl.dataset.importing.columns import Assigned, layout_of
from rigctl.dataset.conditions import cluster
from rigctl.dataset.importing.table import Fault, RawTable
from rigctl.rig.layout import Layout

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigctl.dataset.writer import RunWriter
    from rigctl.rig import Rig


@dataclass(frozen=True)
class Samples:
    """Samples that are ready to be written.

    Parameters
    ----------
    block: SI values, shape (rows, ``layout.columns``); the record's column is filled when it is written.
    labels: the record each row belongs to in the file; `BETWEEN` for none.
    temperature, setpoint: the columns that make a record's condition, where the file has them.
    """

    layout: Layout
    block: NDArray[np.float64]
    labels: NDArray[np.float64]
    temperature: str | None
    setpoint: str | None
    faults: Sequence[Fault]

    @property
    def rows(self) -> int:
        """Number of samples."""
        return len(self.block)

    def write(self, writer: RunWriter, name: str) -> int:
        """Write all of them; returns the number of records."""
        parts = stretches(self.labels)
        sweeps = self._sweeps([part for part in parts if part.label != BETWEEN])
        records = 0
        for part in parts:
            rows = self.block[part.start : part.stop]
            times = rows[:, 0]
            if part.label == BETWEEN:
                rows[:, 1] = -1
            else:
                path = f"record {part.label:g}"
                rows[:, 1] = writer.open_record(float(times[0]), name, sweeps[part.start], path, _rate(times))
                records += 1
            writer.append_block(rows)
            self._log_switches(writer, rows)
            if part.label != BETWEEN:
                writer.close_record(float(times[-1]), "complete")
        return records

    def _sweeps(self, records: Sequence[Stretch]) -> dict[int, Mapping[str, tuple[float, str]]]:
        """By first row: the median set-point, and the median temperature of records that are alike."""
        sweeps: dict[int, dict[str, tuple[float, str]]] = {record.start: {} for record in records}
        for column, same in ((self.temperature, cluster), (self.setpoint, list)):
            if column is None:
                continue
            values = self.block[:, self.layout.columns.index(column)]
            medians = [_median(values[record.start : record.stop]) for record in records]
            for record, value in zip(records, same(medians), strict=True):
                if not np.isnan(value):
                    sweeps[record.start][column] = (value, self.layout.unit(column))
        return dict(sweeps)

    def _log_switches(self, writer: RunWriter, rows: NDArray[np.float64]) -> None:
        """A command that differs from one sample to the next was switched somewhere between the two."""
        switches = []
        first = 2 + len(self.layout.channels)
        for place, actuator in enumerate(self.layout.commands, start=first):
            known = np.flatnonzero(~np.isnan(rows[:, place]))
            values, times = rows[known, place], rows[known, 0]
            for after in (np.flatnonzero(np.diff(values)) + 1).tolist():
                half = 0.5 * float(times[after] - times[after - 1])
                switches.append((float(times[after]) - half, actuator, float(values[after]), half))
        for time, actuator, value, half in sorted(switches):
            writer.event(time, "command", actuator=actuator, value=value, uncertainty=half)


def take_samples(table: RawTable, assigned: Sequence[Assigned], rig: Rig) -> Samples:
    """Turn a table into samples in SI; rows that cannot be taken are left out and listed as faults."""
    layout = layout_of(assigned, rig)
    by_name = {column.name: column for column in assigned}
    values = {column.name: _si(column, table.columns[column.place]) for column in assigned}
    labels = record_labels(values.get("record"), len(table.lines))
    by_column = {column: values[column.name] for column in assigned}
    found = _first_of_each(find_faults(by_column, values["time"], labels, table.lines))
    good = np.ones(len(table.lines), dtype=bool)
    good[list(found)] = False
    block = np.column_stack([values.get(name, labels) for name in layout.columns])[good]
    return Samples(
        layout=layout,
        block=block,
        labels=labels[good],
        temperature=_temperature(by_name, rig),
        setpoint=_setpoint(by_name, rig),
        faults=[*table.faults, *found.values()],
    )


def _first_of_each(faults: Iterable[tuple[int, Fault]]) -> dict[int, Fault]:
    """The first fault of each row."""
    first: dict[int, Fault] = {}
    for index, fault in faults:
        first.setdefault(index, fault)
    return first


def _si(column: Assigned, values: NDArray[np.float64]) -> NDArray[np.float64]:
    if column.unit is None:
        return values
    offset = 0.0 if column.difference else column.unit.offset
    return values * column.unit.factor + offset


def _temperature(by_name: Mapping[str, Assigned], rig: Rig) -> str | None:
    """The channel whose temperature makes the condition."""
    wanted = rig.roles.heat.channel if rig.roles.heat is not None else "oil_temperature"
    return wanted if wanted in by_name else None


def _setpoint(by_name: Mapping[str, Assigned], rig: Rig) -> str | None:
    """The command that sets the pressure."""
    role = rig.roles.set_pressure
    wanted = role.actuator if role is not None else "pressure_setpoint"
    return wanted if wanted in by_name else None


def _median(values: NDArray[np.float64]) -> float:
    present = values[~np.isnan(values)]
    return float(np.median(present)) if len(present) else float("nan")


def _rate(times: NDArray[np.float64]) -> float:
    """Samples a second, from the median step; 0 for a single sample."""
    if len(times) < 2:
        return 0.0
    return float(f"{1.0 / np.median(np.diff(times)):.9g}")  # times are decimals, and their steps not exact
