"""Notes on a run and exclusion of records: appended, then shown in the run's tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from rigctl.dataset.annotations import Annotation, append_annotations, say
from rigctl.dataset.history import read_history
from rigctl.dataset.recording import journal
from rigctl.dataset.recording.finalise import finalise
from rigctl.dataset.recording.writer_lock import PATIENCE, wait_for_lock
from rigctl.dataset.run_json import RUNNING, read_info
from rigctl.errors import RigctlError

#: the text of an annotation that may not be empty
_SAID_WITH: Final = {"note": "the note", "exclude": "the reason"}


def annotate(folder: Path, text: str, *, record: int | None = None) -> None:
    """Add a note to a run, or to one of its records.

    Raises
    ------
    RigctlError
        there is no such record, or the folder cannot be written to.
    """
    _state(folder, [say("note", text, record)])


def exclude(folder: Path, records: Iterable[int], reason: str) -> None:
    """Exclude records from analysis; they stay in the run.

    Raises
    ------
    RigctlError
        there is no such record, or the folder cannot be written to; then none is excluded.
    """
    _state(folder, [say("exclude", reason, record) for record in records])


def include(folder: Path, records: Iterable[int], reason: str) -> None:
    """Include excluded records in the analysis again."""
    _state(folder, [say("include", reason, record) for record in records])


def _state(folder: Path, annotations: Sequence[Annotation]) -> None:
    """Append annotations and rebuild the tables; a run in progress makes them when it ends."""
    count = len(read_history(folder).records)
    for statement in annotations:
        if statement.kind in _SAID_WITH and not statement.text.strip():
            raise RigctlError(f"{_SAID_WITH[statement.kind]} is empty", expected="some words")
        if statement.record is not None and not 0 <= statement.record < count:
            raise RigctlError(
                "there is no such record in the run",
                value=str(statement.record),
                expected=f"0 to {count - 1}" if count else "none, for it has no records",
            )
    append_annotations(folder, annotations)
    # a run in progress makes its tables when it ends; a program that annotates may have made them before
    lock = wait_for_lock(folder, PATIENCE, in_vain=lambda: _in_progress(folder))
    if lock is not None:
        with lock:
            finalise(folder)


def _in_progress(folder: Path) -> bool:
    """Return whether the program that has the lock is recording the run."""
    try:
        return read_info(folder)["status"] == RUNNING or (folder / journal.NAME).exists()
    except RigctlError:
        return False
