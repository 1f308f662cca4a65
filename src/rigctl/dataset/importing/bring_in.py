"""Import of measurement files as a run: completely or not at all.

In: files, a rig, options. Out: a run like any measured one, with remarks on what was assumed. The file is
read twice: the first pass (`take`) finds the columns, checks every row and knows every record; only then
is the second written, into a hidden folder that becomes a run by a single renaming. Whatever fails before
leaves nothing. Why twice: docs/decisions/0014-imported-files-read-twice-groups-are-records.md.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rigctl.argument_types import checks_argument_types
from rigctl.dataset.assumptions import assumed_values
from rigctl.dataset.importing.campaign import Campaign, open_files
from rigctl.dataset.importing.cells.time_column import with_time_column
from rigctl.dataset.importing.cells.times import checked_zone, instant
from rigctl.dataset.importing.columns import assign, read_mapping
from rigctl.dataset.importing.first_pass import Survey
from rigctl.dataset.importing.formats.formats import stem_of
from rigctl.dataset.importing.formats.table import KEPT_FAULTS, Fault, refuse
from rigctl.dataset.importing.log_format import log_format_remark
from rigctl.dataset.importing.notes import column_notes, impossible_notes, notes
from rigctl.dataset.importing.observations import Observations, take_observations
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.read_table import has_numbers, stamped_column
from rigctl.dataset.importing.samples import Samples, take_samples
from rigctl.dataset.importing.staging import NameTakenError, publish, staged
from rigctl.dataset.recording.header import (
    RunHeader,
    Source,
    calibrations_of,
    current_versions,
    source_of_rig,
)
from rigctl.dataset.recording.writer import RunWriter
from rigctl.dataset.run_id import new_run_id
from rigctl.dataset.storage.sending import upload_if_wanted
from rigctl.errors import Location, RigctlError
from rigctl.files.regular import regular
from rigctl.rig import Rig

#: attempts at a name that other imports of the same file take at the same time
_TRIES: Final = 20


@dataclass(frozen=True)
class Imported:
    """An imported run.

    Parameters
    ----------
    left_out: number of bad rows that were left out; `faults` describes the first of them.
    notes: remarks on the data, one sentence each.
    """

    run: str
    path: Path
    records: int
    rows: int
    left_out: int
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]


@checks_argument_types
def import_file(
    path: str | Path,
    rig: Rig | None,
    runs: str | Path,
    *,
    columns: Iterable[str] = (),
    options: Options | None = None,
    keep_good: bool = False,
    name: str | None = None,
    operator: str = "",
) -> Imported:
    """Import a file of samples, or of observations (a table without ``time``), as a new run.

    Parameters
    ----------
    rig: the bench of the measurement: its channels, actuators and calibrations. Not needed for observations.
    runs: the folder that holds the runs.
    columns: ``theirs=ours`` for columns with other names in the file.
    options: how to read the file where that is ambiguous; `columns` take precedence over those of the
        options.
    keep_good: omit bad rows instead of refusing the file.
    name: of the records; by default their names in the file, or else the file's name.

    Raises
    ------
    RigctlError
        the file cannot be read, a column is unknown, or a row is bad; nothing was imported.
    """
    merged = options or Options()
    merged = replace(merged, columns={**merged.columns, **read_mapping(columns)})
    return import_files(
        [Path(path)], rig, Path(runs), merged, keep_good=keep_good, name=name, operator=operator
    )


def import_files(
    paths: Sequence[Path],
    rig: Rig | None,
    runs: Path,
    options: Options,
    *,
    keep_good: bool = False,
    name: str | None = None,
    operator: str = "",
    on_progress: Callable[[str], None] = lambda _: None,
) -> Imported:
    """Import files as one new run, see `import_file`; each is one record unless it contains several.

    Parameters
    ----------
    on_progress: called with the number of rows read so far.

    Raises
    ------
    RigctlError
        a file cannot be read, a column is unknown, or a row is bad; nothing was imported.
    """
    # Compared again at the end: a logger that still writes would give records that the first pass has not
    # seen.
    before = [_state(path) for path in paths]
    taken = take(paths, rig, options, keep_good=keep_good, on_progress=on_progress)
    result = taken.found
    if result.bad_rows and not keep_good:
        raise refuse(paths[0], result.faults, result.bad_rows)
    if not taken.rows:
        raise RigctlError("there is nothing to import", expected="rows of values", where=Location(paths[0]))
    remarks = remarks_of(taken, rig, options)
    # The name has the second in it; imports started by a script may take the same.
    for remaining in reversed(range(_TRIES)):
        header = _header(paths, rig, taken, runs, operator, options)
        try:
            folder, records = _write(taken, header, runs, paths, before, remarks, name)
            break
        except NameTakenError:  # by an import at the same time
            if not remaining:
                raise
    upload_if_wanted(folder)
    return Imported(folder.name, folder, records, taken.rows, result.bad_rows, tuple(result.faults), remarks)


def _write(
    taken: Samples | Observations,
    header: RunHeader,
    runs: Path,
    paths: Sequence[Path],
    before: Sequence[object],
    remarks: Sequence[str],
    name: str | None,
) -> tuple[Path, int]:
    """Write the run, and return its folder and the number of records; after a failure there is none."""
    with staged(runs) as hidden:
        writer = RunWriter.create(hidden, header)
        try:
            _say(writer, remarks, taken.found, paths[0])
            records = taken.write(writer, name, stem_of(paths[0]))
            complete = writer.close("finished")
            _check_unchanged(paths, before)
            return publish(complete, runs), records
        except BaseException as problem:
            writer.discard()
            # A file that changed is the cause of whatever was found wrong in it.
            if isinstance(problem, Exception):
                _check_unchanged(paths, before, problem)
            raise


def remarks_of(taken: Samples | Observations, rig: Rig | None, options: Options) -> tuple[str, ...]:
    """Return remarks on the data, one sentence each."""
    remarks = (*taken.source.remarks, *log_format_remark(taken.source.headings, options))
    remarks += tuple(column_notes(taken.source.headings, taken.assigned, options))
    if isinstance(taken, Observations):
        outside = () if rig is None else tuple(impossible_notes(taken.found, rig))
        return (*remarks, *taken.remarks, *outside)
    if rig is not None:  # as samples need
        assumed = assumed_values(options.assume, rig, taken.layout.columns)
        remarks += (*taken.stages.remarks, *taken.stages.mark_remarks())
        remarks += tuple(notes(taken.found, taken.layout, rig, assumed))
    return remarks


def _check_unchanged(paths: Sequence[Path], before: Sequence[object], cause: Exception | None = None) -> None:
    for path, state in zip(paths, before, strict=True):
        if _state(path) != state:
            raise _changed(path) from cause


def _state(path: Path) -> tuple[int, int] | None:
    """Return what changes when the file is written to; None if it does not exist."""
    try:
        facts = path.stat()
    except OSError:
        return None
    return facts.st_size, facts.st_mtime_ns


def _changed(path: Path) -> RigctlError:
    return RigctlError(
        "the file changed while it was read",
        hint="Wait until the program that writes it has ended, or import a copy",
        where=Location(path),
    )


def _say(writer: RunWriter, notes: Iterable[str], result: Survey, path: Path) -> None:
    """Store the remarks and the omitted rows with the run."""
    for sentence in notes:
        writer.event(0.0, "note", message=sentence)
    for fault in result.faults:
        writer.event(0.0, "gap", message=str(fault.error(Path(path.name))))
    if result.bad_rows > KEPT_FAULTS:
        more = result.bad_rows - KEPT_FAULTS
        writer.event(0.0, "gap", message=f"{path.name}: {more} more rows were left out")


def take(
    paths: Sequence[Path],
    rig: Rig | None,
    options: Options,
    *,
    keep_good: bool,
    on_progress: Callable[[str], None] = lambda _: None,
) -> Samples | Observations:
    """Read the files once, assigning their columns and checking their content.

    Raises
    ------
    RigctlError
        a file cannot be read, or a column or the time zone is unknown.
    """
    checked_zone(options.zone)
    if rig is not None:
        options = replace(options, own=frozenset((*rig.channels, *rig.actuators)))
    source = open_files(paths, options)
    options = with_time_column(((heading.name, heading.unit) for heading in source.headings), options)
    # No column is called time: one whose cells are dates is taken for it, and the file is opened anew with
    # that.
    if not any(options.ours(heading.name) == "time" for heading in source.headings):
        stamped = stamped_column(paths[0], source, options)
        if stamped is not None:
            options = replace(options, columns={**options.columns, stamped: "time"})
            source = open_files(paths, options)
    samples = any(options.ours(heading.name) == "time" for heading in source.headings)
    if samples and rig is None:
        raise RigctlError(
            "samples belong to a rig",
            expected="the rig file of the bench they were measured on: --rig FILE",
            where=Location(paths[0]),
        )
    merged = source.merged if isinstance(source, Campaign) else frozenset()
    settings = replace(options, may_lack=options.may_lack | merged)
    assigned = assign(source.headings, rig, settings, lambda index: has_numbers(source, index))
    if rig is None or not samples:
        if options.split or options.resample:
            raise RigctlError(
                "a table without time has no samples to split or to resample",
                expected="a column 'time', or one that is mapped to it: --columns 'NAME=time [s]'",
                where=Location(paths[0]),
            )
        keep_marks = "none" in options.missing
        return take_observations(source, assigned, options.missing_numbers, keep_marks=keep_marks)
    return take_samples(source, assigned, rig, options, keep_good=keep_good, on_progress=on_progress)


def _header(
    paths: Sequence[Path],
    rig: Rig | None,
    taken: Samples | Observations,
    runs: Path,
    operator: str,
    options: Options,
) -> RunHeader:
    now = datetime.now(UTC)
    calibrations = calibrations_of(rig) if rig is not None else {}
    layout, origin = taken.layout, taken.source.origin
    names = [path.name for path in paths]
    title = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    return RunHeader(
        id=new_run_id(stem_of(paths[0]), now, runs),
        procedure=Source(f"import of {title}"),
        rig=source_of_rig(rig) if rig is not None else Source(""),
        layout=layout,
        started=now if origin is None else instant(origin, options.zone),
        backend={
            "kind": "import",
            "file": ", ".join(names),
            "sha256": ", ".join(_digest(path) for path in paths),
            "imported": now.isoformat(),
        },
        operator=operator,
        clock="recorded",
        versions=current_versions(),
        calibrations={name: calibrations[name] for name in layout.channels if name in calibrations},
        source="import",
        assumed=assumed_values(options.assume, rig, layout.columns),
    )


def _digest(path: Path) -> str:
    with open(path, "rb", opener=regular) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
