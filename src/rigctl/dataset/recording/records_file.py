"""``records.parquet`` and ``events.parquet``: a run's log as tables.

In: the entries of the log. Out: Arrow tables for `finalise`. The log remains the authority; the tables
are for DuckDB, pandas and people, and can be made again from it.

Values are in display units, as in `samples.parquet`, so that any reader of Parquet shows bar and
millimetres; the unit is in the metadata of each column, and `open_run` returns SI. They are rounded to 15
digits, so that 30 bar does not become 29.999999999999996 on its way through pascals. Columns of sweeps
and measures are named as the procedure names them; the metadata say which kind a column is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.history import EventEntry, RecordEntry
from rigctl.dataset.recording.log import encode_line
from rigctl.plan.measured import MeasuredValue
from rigctl.units import parse_unit

if TYPE_CHECKING:
    import pyarrow as pa

RECORDS: Final = "records.parquet"
EVENTS: Final = "events.parquet"
#: columns of every records.parquet, followed by those of the run
FIXED: Final = (
    "record",
    "name",
    "path",
    "rate",
    "session",
    "start",
    "end",
    "outcome",
    "missing",
    "excluded",
)


@dataclass(frozen=True)
class Variable:
    """A column specific to the run: a sweep variable or a measure.

    `column` is `name`, with underscores appended if another column has that name.
    """

    column: str
    name: str
    kind: str  #: sweep, measure or passed
    unit: str
    difference: bool = False

    def metadata(self) -> dict[str, str]:
        """Metadata of the Parquet field."""
        facts = {"kind": self.kind, "unit": self.unit, "variable": self.name}
        return {**facts, "difference": "true"} if self.difference else facts


def records_table(records: Sequence[RecordEntry], excluded: Mapping[int, str]) -> pa.Table:
    """Make a table with one row per record: its facts, sweep values and measures in display units.

    Parameters
    ----------
    excluded: reason by index of record.
    """
    import pyarrow as pa

    fixed: dict[str, tuple[Any, list[Any]]] = {
        "record": (pa.int32(), [entry.index for entry in records]),
        "name": (pa.string(), [entry.name for entry in records]),
        "path": (pa.string(), [entry.path for entry in records]),
        "rate": (pa.float64(), [entry.rate for entry in records]),
        "session": (pa.int32(), [entry.session for entry in records]),
        "start": (pa.float64(), [entry.start for entry in records]),
        "end": (pa.float64(), [entry.end for entry in records]),
        "outcome": (pa.string(), [entry.outcome for entry in records]),
        "missing": (pa.float64(), [entry.missing for entry in records]),
        "excluded": (pa.string(), [excluded.get(entry.index) for entry in records]),
    }
    units = {"rate": "Hz", "start": "s", "end": "s", "missing": "1"}
    fields = [
        pa.field(name, kind, metadata={"kind": "record", "unit": units.get(name, "")})
        for name, (kind, _) in fixed.items()
    ]
    columns: list[Any] = [values for _, values in fixed.values()]
    for variable in _variables(records):
        kind = pa.bool_() if variable.kind == "passed" else pa.float64()
        fields.append(pa.field(variable.column, kind, metadata=variable.metadata()))
        columns.append([_value(entry, variable) for entry in records])
    arrays = [pa.array(column, field.type) for column, field in zip(columns, fields, strict=True)]
    return pa.table(arrays, schema=pa.schema(fields))


def _variables(records: Sequence[RecordEntry]) -> list[Variable]:
    """Return the columns for the records' sweeps and measures, in order of first appearance."""
    variables: dict[tuple[str, str], Variable] = {}
    taken = set(FIXED)

    def add(kind: str, name: str, unit: str, *, difference: bool = False) -> None:
        if (kind, name) in variables:
            return
        column = f"{name}_passed" if kind == "passed" else name
        while column in taken:
            column += "_"
        taken.add(column)
        variables[kind, name] = Variable(column, name, kind, unit, difference)

    for entry in records:
        for name, (_, unit) in entry.sweep.items():
            add("sweep", name, unit)
    for entry in records:
        for measured in entry.measures.values():
            add("measure", measured.name, measured.unit, difference=measured.difference)
            if measured.low is not None or measured.high is not None:
                add("passed", measured.name, "")
    return list(variables.values())


def _value(entry: RecordEntry, variable: Variable) -> float | bool | None:
    if variable.kind == "sweep":
        swept = entry.sweep.get(variable.name)
        return None if swept is None else _shown(swept[0], variable)
    measured = entry.measures.get(variable.name)
    if measured is None:
        return None
    return measured.passed if variable.kind == "passed" else _shown(measured.value, variable)


def _shown(si: float, variable: Variable) -> float:
    """Convert a value to the column's unit, to the 15 digits that are exact: 30 bar, not 29.99…"""
    value = parse_unit(variable.unit).from_si(si, difference=variable.difference)
    return float(f"{value:.15g}") if math.isfinite(value) else value


def events_table(events: Sequence[EventEntry], *, by_time: bool = True) -> pa.Table:
    """Make a table with one row per line of the log; `data` is JSON.

    Sorted by time, or in the order of the log for imported data, whose times may restart in each record.
    """
    import pyarrow as pa

    # stable: simultaneous events keep their order
    ordered = sorted(events, key=lambda entry: entry.time) if by_time else events
    schema = pa.schema(
        [
            pa.field("time", pa.float64(), metadata={"unit": "s"}),
            pa.field("kind", pa.string()),
            pa.field("record", pa.int32()),
            pa.field("path", pa.string()),
            pa.field("message", pa.string()),
            pa.field("data", pa.string()),
        ]
    )
    return pa.table(
        [
            [entry.time for entry in ordered],
            [entry.kind for entry in ordered],
            pa.array([entry.record for entry in ordered], pa.int32()),
            pa.array([entry.path for entry in ordered], pa.string()),
            pa.array([entry.message for entry in ordered], pa.string()),
            pa.array([encode_line(entry.data) for entry in ordered], pa.string()),
        ],
        schema=schema,
    )


def measured_values(measures: Mapping[str, MeasuredValue]) -> list[dict[str, Any]]:
    """Return measures as plain data in display units, for ``run.json``."""
    return [
        {
            "name": measured.name,
            "value": shown_value(measured, measured.value),
            "unit": measured.unit,
            "low": shown_value(measured, measured.low),
            "high": shown_value(measured, measured.high),
            "passed": measured.passed,
            "missing": measured.missing,
        }
        for measured in measures.values()
    ]


def shown_value(measured: MeasuredValue, si: float | None) -> float | None:
    """Return a value or a limit of a measure in its display unit."""
    if si is None:
        return None
    return _shown(si, Variable("", measured.name, "measure", measured.unit, measured.difference))
