"""Comma-separated values with ``name [unit]`` in the heading."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.dataset.exporting.tables import headed

if TYPE_CHECKING:
    import pyarrow as pa


def write(path: Path, table: pa.Table, names: Sequence[str], title: str) -> None:
    """Write numbers in the shortest form that reads back the same; a missing value is an empty cell."""
    import csv

    from pyarrow import csv as arrow_csv

    content = headed(table)
    options = arrow_csv.WriteOptions(include_header=False, quoting_style="needed")
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(content.column_names)
    with path.open("ab") as file:
        for part in _parts(content):
            arrow_csv.write_csv(part, file, options)


def _parts(table: pa.Table, rows: int = 1 << 17) -> Iterator[pa.Table]:
    """Yield some rows at a time, NaN replaced by null."""
    import pyarrow as pa
    import pyarrow.compute as pc

    for start in range(0, table.num_rows, rows):
        part = table.slice(start, rows)
        columns = [
            pc.if_else(pc.is_nan(column), pa.scalar(None, column.type), column)
            if pa.types.is_floating(column.type)
            else column
            for column in part.columns
        ]
        yield pa.table(columns, names=part.column_names)
