"""A run's samples, handed out as a file that any program reads, and that can be brought in again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigctl.dataset.parquet import replace_with, write_error
from rigctl.errors import Location, RigctlError, unknown_name

if TYPE_CHECKING:
    import pyarrow as pa

    from rigctl.dataset.run import Run

#: kinds of file, by the end of the name
FORMATS: Final = ("csv", "parquet")
#: the tables of a run that can be handed out
TABLES: Final = ("samples", "records", "events")


def export_run(
    run: Run,
    path: Path,
    *,
    table: str = "samples",
    records: Sequence[int] | None = None,
    overwrite: bool = False,
) -> int:
    """Write one of a run's tables, its columns named ``name [unit]``; returns the number of rows.

    Parameters
    ----------
    path: its ending says the format: ``.csv`` or ``.parquet``.
    table: ``samples``, ``records`` or ``events``.
    records: only the samples of these records.
    overwrite: replace a file that is there.

    Raises
    ------
    RigctlError
        the file is there already or cannot be written, or there is no such table, format or record.
    """
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in FORMATS:
        endings = " or ".join(f".{name}" for name in FORMATS)
        raise RigctlError("unknown kind of file", value=path.name, expected=f"a name that ends in {endings}")
    if table not in TABLES:
        raise unknown_name("table", table, TABLES)
    if path.exists() and not overwrite:
        raise RigctlError("the file is there already", where=Location(path), hint="'--overwrite' replaces it")
    content = _headed(_table(run, table, records))
    with replace_with(path) as draft, write_error(path):
        (_write_csv if suffix == "csv" else _write_parquet)(draft, content)
    return int(content.num_rows)


def _table(run: Run, table: str, records: Sequence[int] | None) -> pa.Table:
    import pyarrow as pa

    if table != "samples" or records is None:
        return run.table(table)
    return pa.concat_tables([run.table("samples", record=record) for record in records])


def _headed(table: pa.Table) -> pa.Table:
    """The table with ``name [unit]`` for names, and without what only rigctl's own files need."""
    import pyarrow as pa

    fields = []
    for field in table.schema:
        unit = (field.metadata or {}).get(b"unit", b"").decode("utf-8")
        named = unit and not (unit == "1" and field.name == "record")
        fields.append(field.with_name(f"{field.name} [{unit}]" if named else field.name))
    return pa.table(table.columns, schema=pa.schema(fields))


def _write_parquet(path: Path, table: pa.Table) -> None:
    import pyarrow.parquet as pq

    pq.write_table(table, path, compression="zstd")


def _write_csv(path: Path, table: pa.Table) -> None:
    """Numbers in the shortest form that reads back the same; nothing in a cell without a value."""
    import csv

    from pyarrow import csv as arrow_csv

    options = arrow_csv.WriteOptions(include_header=False, quoting_style="needed")
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(table.column_names)
    with path.open("ab") as file:
        for part in _parts(table):
            arrow_csv.write_csv(part, file, options)


def _parts(table: pa.Table, rows: int = 1 << 17) -> Iterator[pa.Table]:
    """Some rows at a time, NaN replaced by nothing."""
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
