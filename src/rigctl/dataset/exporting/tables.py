"""A run's tables for export, without what only rigctl's own files need."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from numpy.typing import NDArray

    from rigctl.dataset.run import Run


@dataclass(frozen=True)
class Column:
    """A column with its unit, "" for none; `values` are numbers, or texts in an array of objects."""

    name: str
    unit: str
    values: NDArray[Any]


@dataclass(frozen=True)
class Piece:
    """Rows that belong together: a record, the samples between two records, or a whole table."""

    name: str
    columns: tuple[Column, ...]


def observations(run: Run) -> pa.Table:
    """Return one row per record: its condition and measures, and its name if the names differ."""
    table = run.table("records")
    fields = [
        table.schema.field(index)
        for index, column in enumerate(table.schema)
        if (column.metadata or {}).get(b"kind") in (b"sweep", b"measure")
    ]
    selection = table.select([field.name for field in fields])
    selection = selection.rename_columns([field.metadata[b"variable"].decode("utf-8") for field in fields])
    if len(set(table["name"].to_pylist())) > 1:
        selection = selection.add_column(0, "record", table["name"])
    return selection


def unit_of(field: pa.Field) -> str:
    """Return the unit of a column, "" for none and for the record number."""
    unit: str = (field.metadata or {}).get(b"unit", b"").decode("utf-8")
    return "" if unit == "1" and field.name == "record" else unit


def headed(table: pa.Table) -> pa.Table:
    """Return the table with columns named ``name [unit]``, without metadata."""
    import pyarrow as pa

    fields = []
    for field in table.schema:
        unit = unit_of(field)
        fields.append(pa.field(f"{field.name} [{unit}]" if unit else field.name, field.type))
    return pa.table(table.columns, schema=pa.schema(fields))


def pieces(table: pa.Table, names: Sequence[str], title: str) -> Iterator[Piece]:
    """Return the samples record by record, in the order of the run; any other table whole.

    A record has its name if that is unique, otherwise name and index. Samples between records have −1 in the
    column ``record``, by which an import recognises them.
    """
    columns = [_column(table, index) for index in range(table.num_columns)]
    if title != "samples":
        yield Piece(title, tuple(columns))
        return
    numbers = {column.name: column.values for column in columns}["record"]
    alike = len(set(names)) < len(names)
    for count, (start, stop) in enumerate(_equal(numbers)):
        record = int(numbers[start])
        slices = [Column(c.name, c.unit, c.values[start:stop]) for c in columns]
        if record < 0:
            yield Piece(f"between records, {count}", tuple(slices))
        else:
            name = f"{names[record]} {record}" if alike else names[record]
            yield Piece(name, tuple(column for column in slices if column.name != "record"))


def _equal(numbers: NDArray[np.int32]) -> list[tuple[int, int]]:
    """Yield the start and end of each stretch of equal numbers."""
    import numpy as np

    edges = (np.flatnonzero(np.diff(numbers)) + 1).tolist()
    return list(pairwise([0, *edges, len(numbers)])) if len(numbers) else []


def _column(table: pa.Table, index: int) -> Column:
    import numpy as np
    import pyarrow as pa

    field, column = table.schema.field(index), table.column(index)
    unit = unit_of(field)
    if pa.types.is_string(field.type) or pa.types.is_large_string(field.type):
        texts = ["" if text is None else text for text in column.to_pylist()]
        return Column(field.name, unit, np.array(texts, dtype=object))
    if pa.types.is_boolean(field.type):
        column = column.cast(pa.int8())
    if column.null_count:
        column = column.cast(pa.float64())
    return Column(field.name, unit, column.to_numpy())


def disarmed_texts(table: pa.Table) -> tuple[pa.Table, int]:
    """Put an apostrophe before each text that a spreadsheet would interpret as a formula; count them.

    Such texts begin with ``= + - @``, a tab or a carriage return (OWASP, CSV injection).
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    columns, count = [], 0
    for column in table.columns:
        if not pa.types.is_string(column.type):
            columns.append(column)
            continue
        armed = pc.match_substring_regex(column, r"^[=+\-@\t\r]")
        count += pc.sum(armed).as_py() or 0
        columns.append(pc.if_else(armed, pc.binary_join_element_wise("'", column, ""), column))
    return pa.table(columns, schema=table.schema), count
