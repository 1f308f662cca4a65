"""What a person says about a run afterwards: notes, and records left out of analysis with a reason.

``annotations.jsonl`` is only ever appended to. A record that was excluded can be included again; both
statements stay.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from getpass import getuser
from pathlib import Path
from typing import Any, Final, Literal

from rigctl.dataset.log import LogWriter, read_lines
from rigctl.errors import ExitCode, Location, RigctlError

NAME: Final = "annotations.jsonl"


@dataclass(frozen=True)
class Annotation:
    """One statement; `record` is None when it is about the whole run."""

    when: str
    by: str
    kind: Literal["note", "exclude", "include"]
    text: str
    record: int | None = None


def read_annotations(folder: Path) -> list[Annotation]:
    """All statements about a run, oldest first.

    Raises
    ------
    RigctlError
        the file is damaged; names the line.
    """
    path = folder / NAME
    if not path.exists():
        return []
    found = []
    for number, line in enumerate(read_lines(path), start=1):
        try:
            found.append(Annotation(**(line or {})))
        except TypeError as problem:
            raise RigctlError(
                "the line is damaged", where=Location(path, number), exit_code=ExitCode.FAILED
            ) from problem
    return found


def excluded_records(annotations: Iterable[Annotation]) -> dict[int, str]:
    """Reason by index of every record that is left out of analysis."""
    reasons: dict[int, str] = {}
    for said in annotations:
        if said.record is None:
            continue
        if said.kind == "exclude":
            reasons[said.record] = said.text
        elif said.kind == "include":
            reasons.pop(said.record, None)
    return reasons


def append_annotations(folder: Path, annotations: Iterable[Annotation]) -> None:
    """Add statements to a run's file; it is not yet seen in its tables, see `rigctl.dataset.curate`."""
    path = folder / NAME
    try:
        writer = LogWriter(path)
        try:
            for said in annotations:
                writer.append(asdict(said))
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
    """A statement by the person at the keyboard, now."""
    try:
        by = getuser()
    except (OSError, KeyError, ImportError):
        by = ""
    return Annotation(datetime.now(UTC).isoformat(timespec="seconds"), by, kind, text, record)


def as_data(annotations: Iterable[Annotation]) -> list[dict[str, Any]]:
    """The statements as plain data, for ``run.json``."""
    return [asdict(said) for said in annotations]
