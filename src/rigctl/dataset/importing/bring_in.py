"""A file of measurements becomes a run: all of it or nothing."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigctl.dataset.header import RunHeader, Source, calibrations_of, current_versions, source_of_rig
from rigctl.dataset.importing.columns import assign, read_mapping
from rigctl.dataset.importing.csv_file import read_csv
from rigctl.dataset.importing.observations import take_observations
from rigctl.dataset.importing.parquet_file import read_parquet
from rigctl.dataset.importing.samples import take_samples
from rigctl.dataset.importing.table import Fault, RawTable, refuse
from rigctl.dataset.run_id import new_run_id
from rigctl.dataset.writer import RunWriter
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    from rigctl.rig import Layout, Rig

#: how a file is read, by the end of its name
READERS: Final[Mapping[str, Callable[[Path], RawTable]]] = {
    ".csv": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".parquet": read_parquet,
}


@dataclass(frozen=True)
class Imported:
    """The run that a file became; `left_out` are the bad rows that were not taken in."""

    run: str
    path: Path
    records: int
    rows: int
    left_out: tuple[Fault, ...]


def import_file(
    path: Path,
    rig: Rig,
    runs: Path,
    *,
    columns: Iterable[str] = (),
    keep_good: bool = False,
    name: str | None = None,
    operator: str = "",
) -> Imported:
    """Bring in a file of samples, or of observations (a table without ``time``), as a new run.

    Parameters
    ----------
    rig: the bench it was measured on: its channels, actuators and calibrations.
    runs: the folder that holds the runs.
    columns: ``theirs=ours`` for columns that are called otherwise in the file.
    keep_good: leave bad rows out instead of refusing the file.
    name: of the records; the file's name when left out.

    Raises
    ------
    RigctlError
        the file cannot be read, a column is unknown, or a row is bad; nothing was imported.
    """
    table = _reader(path)(path)
    assigned = assign(table.headings, rig, read_mapping(columns))
    timed = any(column.kind == "time" for column in assigned)
    taken = (take_samples if timed else take_observations)(table, assigned, rig)
    if taken.faults and not keep_good:
        raise refuse(path, taken.faults)
    if not taken.rows:
        raise RigctlError("there is nothing to import", where=Location(path))
    header = _header(path, rig, taken.layout, runs, operator)
    writer = RunWriter.create(runs, header)
    try:
        for fault in taken.faults:
            writer.event(0.0, "gap", message=str(fault.error(Path(path.name))))
        records = taken.write(writer, name or path.stem)
        folder = writer.close("finished")
    except BaseException:
        writer.discard()
        raise
    return Imported(writer.id, folder, records, taken.rows, tuple(taken.faults))


def _reader(path: Path) -> Callable[[Path], RawTable]:
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise RigctlError(
            "unknown kind of file", value=path.name, expected=f"a name that ends in {', '.join(READERS)}"
        )
    return reader


def _header(path: Path, rig: Rig, layout: Layout, runs: Path, operator: str) -> RunHeader:
    now = datetime.now(UTC)
    calibrations = calibrations_of(rig)
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return RunHeader(
        id=new_run_id(path.stem, now, runs),
        procedure=Source(f"import of {path.name}"),
        rig=source_of_rig(rig),
        layout=layout,
        started=now,
        backend={"kind": "import", "file": path.name, "sha256": digest},
        operator=operator,
        clock="recorded",
        versions=current_versions(),
        calibrations={name: calibrations[name] for name in layout.channels if name in calibrations},
        source="import",
    )
