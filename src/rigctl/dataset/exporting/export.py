"""Export of a run's tables to files that other programs read and that can be imported again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, cast

from rigctl.argument_types import checks_argument_types
from rigctl.dataset.exporting.tables import disarmed_texts, observations
from rigctl.dataset.outputs import require_output
from rigctl.dataset.parquet import replace_with
from rigctl.dataset.run import Run
from rigctl.errors import RigctlError, unknown_name
from rigctl.files.write import write_error
from rigctl.plugins import load_plugin, plugin_names

if TYPE_CHECKING:
    import pyarrow as pa


#: writer modules by file extension
FORMATS: Final[Mapping[str, str]] = {
    ".csv": "csv_file",
    ".parquet": "parquet_file",
    ".tdms": "tdms_file",
    ".mf4": "mdf_file",
    ".mat": "mat_file",
    ".xlsx": "xlsx_file",
}
#: group of the entry points of other packages: by extension, a `Writer`
ENTRY_POINTS: Final = "rigctl.exporters"
#: the tables of a run that can be exported
TABLES: Final = ("samples", "observations", "records", "events")


class Exported(NamedTuple):
    """Numbers of rows written and of cells disarmed."""

    rows: int
    disarmed: int


class Writer(Protocol):
    """Writes a table to a new file: `names` are the records' names by index, `title` what the table is."""

    def __call__(self, path: Path, table: pa.Table, names: Sequence[str], title: str) -> None:
        """Write it."""


@checks_argument_types
def export_run(
    run: Run,
    path: str | Path,
    *,
    table: str | None = None,
    records: Sequence[int] | None = None,
    overwrite: bool = False,
    disarm: bool = False,
) -> Exported:
    """Write one of a run's tables, every column with its unit.

    Parameters
    ----------
    path: its extension selects the format: ``.csv``, ``.parquet``, ``.tdms``, ``.mf4``, ``.mat`` or
        ``.xlsx``.
    table: ``samples``; ``observations``, the condition and the measures of every record; ``records`` or
        ``events``. By default the samples, or the observations of a run without samples.
    records: only the samples of these records.
    overwrite: replace an existing file.
    disarm: for CSV, put an apostrophe before every text that begins with one of ``= + - @``, so that no
        spreadsheet interprets it as a formula. Numbers are unchanged.

    Raises
    ------
    RigctlError
        the file exists or cannot be written, there is no such table, format or record, or the package for the
        format is not installed.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    installed = () if suffix in FORMATS else plugin_names(ENTRY_POINTS)
    if suffix not in FORMATS and suffix not in installed:
        endings = ", ".join((*FORMATS, *installed))
        raise RigctlError("unknown kind of file", value=path.name, expected=f"a name that ends in {endings}")
    wanted = table or default_table(run)
    if wanted not in TABLES:
        raise unknown_name("table", wanted, TABLES)
    require_output(path, force=overwrite, option="--overwrite")
    content = _table(run, wanted, records).replace_schema_metadata({"started": run.info["started"]})
    disarmed = 0
    if disarm and suffix == ".csv":
        content, disarmed = disarmed_texts(content)
    write = _writer(suffix)
    with replace_with(path) as draft, write_error(path):
        write(draft, content, run.records["name"].tolist(), wanted)
    return Exported(int(content.num_rows), disarmed)


def _writer(suffix: str) -> Writer:
    """Return the writer of a kind of file: rigctl's own, or that of an installed package."""
    if suffix in FORMATS:
        return cast("Writer", import_module(f"rigctl.dataset.exporting.{FORMATS[suffix]}").write)
    write: Writer = load_plugin(ENTRY_POINTS, suffix)
    return write


def export_junit(run: Run, path: Path, *, overwrite: bool = False) -> int:
    """Write the measures of a run as test cases in JUnit XML, and return their number.

    Raises
    ------
    RigctlError
        the file exists or cannot be written, or a file of the run is missing or damaged.
    """
    from rigctl.dataset.exporting import junit

    require_output(path, force=overwrite, option="--overwrite")
    with replace_with(path) as draft:
        return junit.write(run, draft)


def default_table(run: Run) -> str:
    """Return ``samples``, or ``observations`` for a run without samples."""
    return "samples" if run.info["rows"] or not run.info["records"] else "observations"


def _table(run: Run, table: str, records: Sequence[int] | None) -> pa.Table:
    import pyarrow as pa

    if table == "observations":
        return observations(run)
    if table != "samples" or records is None:
        return run.table(table)
    if not records:
        raise RigctlError("no records are chosen", expected="their numbers, or none given for all of them")
    return pa.concat_tables([run.table("samples", record=record) for record in records])
