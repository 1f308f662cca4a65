"""SQL over all runs: DuckDB queries their Parquet files, without access to the file system.

In: one SELECT, typed by a person or sent by a page, which may be anything. Out: its rows. Three limits
make it harmless: the statement must be a single SELECT; Arrow opens the runs' files and hands DuckDB
their data, so that the database is left without any file system; and memory, temporary files and
extensions are restricted before the query is carried out. The last setting locks all of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

from rigctl.argument_types import checks_argument_types
from rigctl.dataset.catalogue import list_runs
from rigctl.dataset.index.rows import DAMAGED
from rigctl.dataset.recording import journal, records_file, samples_file
from rigctl.dataset.run_fields import COLUMNS, column_values
from rigctl.dataset.run_json import RUNNING, read_info
from rigctl.dataset.table_columns import open_table
from rigctl.errors import RigctlError, unknown_name

if TYPE_CHECKING:
    import duckdb
    import pandas as pd
    import pyarrow as pa
    import pyarrow.dataset as ds

    from rigctl.dataset.storage.store import StoredFolder

#: views over the files of all runs, and their columns if there is no run
_FILES: Final[Mapping[str, tuple[str, str]]] = {
    "samples": (samples_file.NAME, "time DOUBLE, record INTEGER"),
    "records": (
        records_file.RECORDS,
        "record INTEGER, name VARCHAR, path VARCHAR, rate DOUBLE, session INTEGER, "
        'start DOUBLE, "end" DOUBLE, outcome VARCHAR, excluded VARCHAR',
    ),
    "events": (
        records_file.EVENTS,
        "time DOUBLE, kind VARCHAR, record INTEGER, path VARCHAR, message VARCHAR, data VARCHAR",
    ),
}
#: interval of checks for Ctrl-C during a query, s; an unlimited wait ignores it on Windows
_LOOK: Final = 0.2
#: largest answer, bytes, and rows that are counted at a time
_LARGEST: Final = 500_000_000
_BATCH: Final = 100_000
#: memory limit of the database
_MEMORY: Final = "2GB"
#: all views
VIEWS: Final = ("runs", "records", "samples", "events", "units")


@dataclass(frozen=True)
class QueryResult:
    """The result of a query: names of the columns, and the rows."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def frame(self) -> pd.DataFrame:
        """Return the result as a data frame."""
        import pandas as pd

        return pd.DataFrame(list(self.rows), columns=list(self.columns))


@checks_argument_types
def query(sql: str, runs: str | Path | None = None, *, where: str | None = None) -> QueryResult:
    """Run one SELECT over all closed runs, or over those that meet a condition.

    The views are `runs` (one row per run), `records`, `samples` and `events` (each with the run's id in
    ``run``; columns that only some runs have are NULL in the others), and `units` (the unit of each column of
    a run's samples). Values are in display units.

    The query can only read the runs' Parquet files, and cannot write anything.

    Parameters
    ----------
    where: a condition as in `rigctl.dataset.list_runs`; the files of other runs are not opened.

    Raises
    ------
    RigctlError
        the SQL is wrong or not a SELECT; names the nearest table or column.
    """
    import duckdb

    closed = _closed_runs([run.folder for run in list_runs(runs, where=where) if run.status != DAMAGED])
    with duckdb.connect(":memory:") as connection:
        try:
            _require_select(sql)
            _make_views(connection, closed, sql)
            answer = _interruptible(connection, sql)
        except duckdb.Error as problem:
            _refuse(connection, problem)
        columns = [[_plain(value) for value in column.to_pylist()] for column in answer.columns]
        return QueryResult(tuple(answer.column_names), tuple(zip(*columns, strict=True)))


def _interruptible(connection: duckdb.DuckDBPyConnection, sql: str) -> pa.Table:
    """Run the query in a thread, so that Ctrl-C can stop the database.

    The database itself ignores signals while it computes.
    """
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(lambda: _whole_answer(connection, sql))
        try:
            while True:
                try:
                    return answer.result(timeout=_LOOK)
                except TimeoutError:
                    if answer.done():
                        raise
        except BaseException:  # for any exception, since leaving would wait for the thread
            connection.interrupt()
            raise


def _whole_answer(connection: duckdb.DuckDBPyConnection, sql: str) -> pa.Table:
    """Return the answer, unless it would fill the memory as Python's objects.

    Raises
    ------
    RigctlError
        it is too large.
    """
    import pyarrow as pa

    reader = connection.sql(sql).to_arrow_reader(_BATCH)
    batches, size = [], 0
    for batch in reader:
        batches.append(batch)
        size += batch.nbytes
        if size > _LARGEST:
            raise RigctlError(
                "the answer is too large",
                expected=f"at most {_LARGEST / 1e6:.0f} MB",
                hint="Select fewer rows or columns, or read the runs' files in Python",
            )
    return pa.Table.from_batches(batches, reader.schema)


def _closed_runs(folders: Iterable[Path | StoredFolder]) -> dict[Path | StoredFolder, dict[str, Any]]:
    """Return ``run.json`` of the runs whose tables exist."""
    infos: dict[Path | StoredFolder, dict[str, Any]] = {}
    for folder in folders:
        if not isinstance(folder, Path):
            infos[folder] = folder.info
            continue
        try:
            info = read_info(folder)
        except RigctlError:
            continue
        if info["status"] != RUNNING and not (folder / journal.NAME).exists():
            infos[folder] = info
    return infos


def _require_select(sql: str) -> None:
    import duckdb

    try:
        sql.encode("utf-8")
    except UnicodeEncodeError as problem:
        raise RigctlError("the query is not UTF-8 text", value=sql) from problem
    statements = duckdb.extract_statements(sql)
    allowed = (duckdb.StatementType.SELECT, duckdb.StatementType.EXPLAIN)
    if len(statements) != 1:
        raise RigctlError("not one query", value=sql, expected="one SELECT")
    if statements[0].type not in allowed:
        raise RigctlError("the query would not only read", value=sql, expected="a SELECT")


def _make_views(
    connection: duckdb.DuckDBPyConnection, closed: Mapping[Path | StoredFolder, Mapping[str, Any]], sql: str
) -> None:
    """Make the views that the query names, then disable the database's access to file systems.

    Arrow opens the runs' files for reading and passes their data to the database, which can open no file. A
    query can therefore not write to one.
    """
    _make_runs(connection, closed.values())
    _make_units(connection, closed.values())
    for view, (file, empty) in _FILES.items():
        # Files are opened only for views that the query names: with many runs, opening them all is what takes
        # time.
        if closed and re.search(view, sql, re.IGNORECASE):
            connection.register(view, _files_as_one(closed, file))
        else:
            connection.execute(f"CREATE TABLE {view} (run VARCHAR, {empty})")
    for setting in (
        "TimeZone = 'UTC'",
        "temp_directory = ''",
        f"memory_limit = '{_MEMORY}'",
        "enable_external_access = false",
        "disabled_filesystems = 'LocalFileSystem'",
        "autoinstall_known_extensions = false",
        "autoload_known_extensions = false",
        "python_enable_replacements = false",
        "lock_configuration = true",
    ):
        connection.execute(f"SET {setting}")


def _files_as_one(folders: Iterable[Path | StoredFolder], file: str) -> ds.Dataset:
    """Combine one file of every run into a table: columns by name, null if absent; `run` is the folder.

    Raises
    ------
    RigctlError
        a file is missing or damaged, or runs have columns of the same name and different types.
    """
    import pyarrow as pa
    import pyarrow.dataset as ds
    from pyarrow.fs import LocalFileSystem

    form, local = ds.ParquetFileFormat(), LocalFileSystem()
    fragments: dict[int, tuple[Any, list[Any]]] = {}
    schemas = [pa.schema([("run", pa.string())])]
    for folder in folders:
        path = folder / file
        with open_table(path) as opened:
            schemas.append(pa.schema([(field.name, field.type) for field in opened.schema_arrow]))
        # The run's id is no column of the file: it is stated as a partition, by which runs are also left out
        # unread.
        named = ds.field("run") == folder.name
        if isinstance(folder, Path):
            files, where = local, str(path)
        else:
            files, where = folder.store.arrow, folder.store.path(folder.name, file)
        fragment = form.make_fragment(where, files, partition_expression=named)
        fragments.setdefault(id(files), (files, []))[1].append(fragment)
    try:
        schema = pa.unify_schemas(schemas, promote_options="permissive")
    except pa.ArrowException as problem:
        raise RigctlError(
            f"the runs' files {file} cannot be read as one table: {problem}",
            hint="Query runs with unlike columns in folders of their own",
        ) from problem
    parts = [ds.FileSystemDataset(fragment, schema, form, files) for files, fragment in fragments.values()]
    return parts[0] if len(parts) == 1 else ds.dataset(parts)


def _make_runs(connection: duckdb.DuckDBPyConnection, infos: Iterable[Mapping[str, Any]]) -> None:
    columns = ", ".join(f'"{name}" {kind}' for name, kind in COLUMNS.items())
    connection.execute(f"CREATE TABLE runs ({columns})")
    _insert(connection, "runs", [tuple(column_values(info).values()) for info in infos])


def _make_units(connection: duckdb.DuckDBPyConnection, infos: Iterable[Mapping[str, Any]]) -> None:
    connection.execute('CREATE TABLE units (run VARCHAR, "column" VARCHAR, unit VARCHAR)')
    rows = []
    for info in infos:
        layout = info["layout"]
        names = ("time", "record", *layout["channels"], *layout["commands"])
        rows += [[info["id"], name, unit] for name, unit in zip(names, layout["units"], strict=True)]
    _insert(connection, "units", rows)


def _insert(connection: duckdb.DuckDBPyConnection, table: str, rows: Sequence[Sequence[Any]]) -> None:
    """Insert many rows at once, since one statement for each is slow."""
    for start in range(0, len(rows), 256):
        part = rows[start : start + 256]
        marks = ", ".join("(" + ", ".join("?" * len(row)) + ")" for row in part)
        values = [value for row in part for value in row]
        connection.execute(f"INSERT INTO {table} VALUES {marks}", values)  # noqa: S608 - names are rigctl's


def _plain(value: Any) -> Any:
    """Convert exact decimals, such as sums of integers, to numbers."""
    if not isinstance(value, Decimal):
        return value
    return int(value) if value == value.to_integral_value() else float(value)


def _refuse(connection: duckdb.DuckDBPyConnection, problem: Exception) -> NoReturn:
    """Return the database's error as a RigctlError, with the nearest name if a name was wrong."""
    text = str(problem)
    if table := re.search(r"Table with name (\S+) does not exist", text):
        raise unknown_name("table", table.group(1), VIEWS) from problem
    if column := re.search(r'Referenced column "([^"]+)" not found', text):
        raise unknown_name("column", column.group(1), _column_names(connection, text)) from problem
    what = text.strip().splitlines()[0].partition("Error: ")[2] or text.strip().splitlines()[0]
    quoted = re.search(r"^LINE (\d+): (.*)$", text, re.MULTILINE)
    raise RigctlError(
        f"the database refuses the query: {what}",
        value=quoted.group(2) if quoted else None,
        hint=f"The tables are {', '.join(VIEWS)}",
    ) from problem


def _column_names(connection: duckdb.DuckDBPyConnection, text: str) -> list[str]:
    """Return the columns of the tables read by the refused query."""
    line = re.search(r"^LINE \d+: (.*)$", text, re.MULTILINE)
    read = [view for view in VIEWS if line and re.search(rf"\b{view}\b", line.group(1), re.IGNORECASE)]
    rows = connection.execute(
        "SELECT DISTINCT column_name FROM duckdb_columns() "
        "WHERE NOT internal AND list_contains(?, table_name)",
        [read or list(VIEWS)],
    ).fetchall()
    return [row[0] for row in rows]
