"""A file of measurements becomes a run: all of it or nothing."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.dataset.header import RunHeader, Source, calibrations_of, current_versions, source_of_rig
from rigctl.dataset.importing.columns import assign, read_mapping
from rigctl.dataset.importing.formats import open_source, stem_of
from rigctl.dataset.importing.notes import notes
from rigctl.dataset.importing.observations import Observations, take_observations
from rigctl.dataset.importing.samples import Samples, take_samples
from rigctl.dataset.importing.staging import publish, staged
from rigctl.dataset.importing.survey import KEPT_FAULTS, Survey
from rigctl.dataset.importing.table import Fault, refuse
from rigctl.dataset.run_id import new_run_id
from rigctl.dataset.writer import RunWriter
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    from rigctl.rig import Layout, Rig


@dataclass(frozen=True)
class Imported:
    """The run that a file became.

    Parameters
    ----------
    left_out: how many bad rows were not taken in; `faults` says what is wrong with the first of them.
    notes: what is worth knowing of the data, one sentence each.
    """

    run: str
    path: Path
    records: int
    rows: int
    left_out: int
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]


def import_file(
    path: Path,
    rig: Rig | None,
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
    rig: the bench it was measured on: its channels, actuators and calibrations. Observations need none.
    runs: the folder that holds the runs.
    columns: ``theirs=ours`` for columns that are called otherwise in the file.
    keep_good: leave bad rows out instead of refusing the file.
    name: of the records; when left out, what the file calls them, else the file's name.

    Raises
    ------
    RigctlError
        the file cannot be read, a column is unknown, or a row is bad; nothing was imported.
    """
    before = _state(path)
    taken = _take(path, rig, columns)
    found = taken.found
    if found.bad_rows and not keep_good:
        raise refuse(path, found.faults, found.bad_rows)
    if not taken.rows:
        raise RigctlError("there is nothing to import", expected="rows of values", where=Location(path))
    said = taken.source.remarks
    if isinstance(taken, Samples) and rig is not None:
        said += tuple(notes(found, taken.layout, rig))
    with staged(runs) as hidden:
        writer = RunWriter.create(hidden, _header(path, rig, taken.layout, runs, operator))
        try:
            _say(writer, said, found, path)
            records = taken.write(writer, name, stem_of(path))
            whole = writer.close("finished")
            if _state(path) != before:
                raise _changed(path)
            folder = publish(whole, runs)
        except BaseException as problem:
            writer.discard()
            if isinstance(problem, Exception) and _state(path) != before:
                raise _changed(path) from problem
            raise
    return Imported(folder.name, folder, records, taken.rows, found.bad_rows, tuple(found.faults), said)


def _state(path: Path) -> tuple[int, int] | None:
    """What changes when somebody writes to the file; None for a file that is not there."""
    try:
        facts = path.stat()
    except OSError:
        return None
    return facts.st_size, facts.st_mtime_ns


def _changed(path: Path) -> RigctlError:
    return RigctlError(
        "the file changed while it was read",
        hint="Wait until what writes it has ended, or import a copy",
        where=Location(path),
    )


def _say(writer: RunWriter, notes: Iterable[str], found: Survey, path: Path) -> None:
    """Keep with the run what is worth knowing of it, and which rows it does not have."""
    for sentence in notes:
        writer.event(0.0, "note", message=sentence)
    for fault in found.faults:
        writer.event(0.0, "gap", message=str(fault.error(Path(path.name))))
    if found.bad_rows > KEPT_FAULTS:
        more = found.bad_rows - KEPT_FAULTS
        writer.event(0.0, "gap", message=f"{path.name}: {more} more rows were left out")


def _take(path: Path, rig: Rig | None, columns: Iterable[str]) -> Samples | Observations:
    """Go through the file once: what its columns are, and what is in it."""
    mapping = read_mapping(columns)
    source = open_source(path, mapping)
    named = (mapping.get(heading.name, heading.name) for heading in source.headings)
    samples = any(name.partition("[")[0].strip() == "time" for name in named)
    if samples and rig is None:
        raise RigctlError(
            "samples belong to a rig",
            expected="the rig file of the bench they were measured on: --rig FILE",
            where=Location(path),
        )
    assigned = assign(source.headings, rig, mapping)
    if rig is None or not samples:
        return take_observations(source, assigned)
    return take_samples(source, assigned, rig)


def _header(path: Path, rig: Rig | None, layout: Layout, runs: Path, operator: str) -> RunHeader:
    now = datetime.now(UTC)
    calibrations = calibrations_of(rig) if rig is not None else {}
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return RunHeader(
        id=new_run_id(stem_of(path), now, runs),
        procedure=Source(f"import of {path.name}"),
        rig=source_of_rig(rig) if rig is not None else Source(""),
        layout=layout,
        started=now,
        backend={"kind": "import", "file": path.name, "sha256": digest},
        operator=operator,
        clock="recorded",
        versions=current_versions(),
        calibrations={name: calibrations[name] for name in layout.channels if name in calibrations},
        source="import",
    )
