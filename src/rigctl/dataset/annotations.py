"""Notes on a run, and records excluded from analysis with a reason, added by a person afterwards.

``annotations.jsonl`` is only ever appended to. A record that was excluded can be included again; both entries
are kept.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from getpass import getuser
from pathlib import Path
from typing import Any, Final, Literal

from rigctl.dataset.recording.log import LogWriter, read_lines
from rigctl.dataset.recording.writer_lock import lock_annotations
from rigctl.errors import ExitCode, Location, RigctlError

NAME: Final = "annotations.jsonl"


@dataclass(frozen=True)
class Annotation:
    """One note or exclusion; `record` is None if it concerns the whole run."""

    when: str
    by: str
    kind: Literal["note", "exclude", "include"]
    text: str
    record: int | None = None


def read_annotations(folder: Path) -> list[Annotation]:
    """Read all annotations of a run, oldest first.

    Raises
    ------
    RigctlError
        the file is damaged; names the line.
    """
    path = folder / NAME
    if not path.exists():
        return []
    annotations = []
    for number, line in enumerate(read_lines(path), start=1):
        try:
            annotations.append(Annotation(**(line or {})))
        except TypeError as problem:
            raise RigctlError(
                "the line is damaged", where=Location(path, number), exit_code=ExitCode.FAILED
            ) from problem
    return annotations


def excluded_records(annotations: Iterable[Annotation]) -> dict[int, str]:
    """Return the reason by index of every excluded record."""
    reasons: dict[int, str] = {}
    for annotation in annotations:
        if annotation.record is None:
            continue
        if annotation.kind == "exclude":
            reasons[annotation.record] = annotation.text
        elif annotation.kind == "include":
            reasons.pop(annotation.record, None)
    return reasons


def append_annotations(folder: Path, annotations: Iterable[Annotation]) -> None:
    """Append annotations to a run's file; the tables follow with `rigctl.dataset.curate`."""
    path = folder / NAME
    try:
        with lock_annotations(folder):
            writer = LogWriter(path)
            try:
                for annotation in annotations:
                    writer.append(asdict(annotation))
                writer.flush()
                writer.sync()
            finally:
                writer.close()
    except OSError as problem:
        raise RigctlError(
            f"cannot write the annotation: {problem.strerror}",
            where=Location(path),
            exit_code=ExitCode.FAILED,
        ) from problem


def say(kind: Literal["note", "exclude", "include"], text: str, record: int | None = None) -> Annotation:
    """Make an annotation by the current user, now."""
    try:
        by = getuser()
    except (OSError, KeyError, ImportError):
        by = ""
    return Annotation(datetime.now(UTC).isoformat(timespec="seconds"), by, kind, text, record)


def as_data(annotations: Iterable[Annotation]) -> list[dict[str, Any]]:
    """Return the annotations as plain data, for ``run.json``."""
    return [asdict(annotation) for annotation in annotations]
