"""Verifies that a run is intact, and recovers one that its program could not close."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from rigctl.dataset import run_json
from rigctl.dataset.annotations import NAME as ANNOTATIONS
from rigctl.dataset.history import read_history
from rigctl.dataset.recording import journal, log
from rigctl.dataset.recording.finalise import finalise
from rigctl.dataset.recording.writer_lock import try_lock
from rigctl.dataset.storage.store import StoredFolder
from rigctl.errors import RigctlError
from rigctl.files.regular import regular
from rigctl.wording import noun, number_of


class Condition(Enum):
    """The condition of a run's folder."""

    WHOLE = "whole"  #: every file exists and is unchanged since the run was closed
    RECOVERED = "recovered"  #: it was not closed; its tables have now been made from journal and log
    IN_PROGRESS = "in progress"  #: a program is writing to it; unchanged
    BROKEN = "broken"  #: a file is missing, changed or damaged


@dataclass(frozen=True)
class Verification:
    """The result for one run; `problems` lists what is broken, or what was recovered."""

    id: str
    folder: Path | StoredFolder
    condition: Condition
    problems: tuple[str, ...] = ()

    @property
    def good(self) -> bool:
        """False only for a broken run."""
        return self.condition is not Condition.BROKEN


def verify(folder: Path) -> Verification:
    """Check a run's files against the checksums of its ``run.json``; recover it if it was never closed.

    A run in progress is not touched. The content of the folder never raises an error.
    """
    try:
        info = run_json.read_info(folder)
    except RigctlError:
        # A damaged ``run.json`` is not the end: the log and the journal are what it is made from.
        info = None
    try:
        # Three reasons to make the tables again, all of them left by a kill or by damage; otherwise nothing
        # is written.
        if info is None or _unclosed(folder, info) or _annotated_since(folder, info):
            return _recover(folder, info)
    except RigctlError as problem:
        return Verification(folder.name, folder, Condition.BROKEN, tuple(str(problem).splitlines()))
    except OSError as problem:
        said = f"{Path(problem.filename).as_posix()}: cannot read the file: {problem.strerror}"
        return Verification(folder.name, folder, Condition.BROKEN, (said,))
    problems = _compare(folder, info)
    return Verification(folder.name, folder, Condition.BROKEN if problems else Condition.WHOLE, problems)


def _unclosed(folder: Path, info: dict[str, Any]) -> bool:
    """Return whether the run was never closed: closing a run removes its journal last."""
    return info["status"] == run_json.RUNNING or (folder / journal.NAME).exists()


def _annotated_since(folder: Path, info: dict[str, Any]) -> bool:
    """Return whether annotations were appended, but a kill prevented the tables from being rebuilt."""
    path = folder / ANNOTATIONS
    if not path.exists():
        return False
    with open(path, "rb", opener=regular) as file:
        content, known = file.read(), info.get("files", {}).get(ANNOTATIONS)
    if known is None:
        return True
    before = content[: known["bytes"]]
    return len(content) > len(before) and hashlib.sha256(before).hexdigest() == known["sha256"]


def _recover(folder: Path, info: dict[str, Any] | None) -> Verification:
    lock = try_lock(folder)
    if lock is None:
        return Verification(folder.name, folder, Condition.IN_PROGRESS)
    messages = []
    with lock:
        if info is None:
            read_history(folder)  # raises if nothing can be rebuilt: then nothing is changed
            backup = run_json.set_aside(folder)
            messages.append("run.json was damaged, changed or missing; it was made again from the log")
            if backup is not None:
                messages.append(f"what stood there is kept as {backup.name}")
        facts = finalise(folder)
    messages.append(
        f"{number_of(facts['rows'], 'sample')} and {facts['complete_records']} of {facts['records']} records "
        "are complete"
    )
    if facts["lost_bytes"]:
        messages.append(
            f"{facts['lost_bytes']} bytes of the journal are damaged and lost; the journal is kept as it is, "
            f"as {journal.NAME}.damaged-…"
        )
    if lost := facts["lost_rows"]:
        messages.append(
            f"at least {number_of(lost, 'sample')} {noun(lost, 'is', 'are')} lost; "
            "records that miss some are 'damaged', and the journal is kept"
        )
    if facts["damaged_lines"]:
        lines = ", ".join(str(line) for line in facts["damaged_lines"])
        path = (folder / log.NAME).as_posix()
        messages.append(f"{path}: what line {lines} said is lost; a record open then is 'damaged'")
    return Verification(folder.name, folder, Condition.RECOVERED, tuple(messages))


def _compare(folder: Path, info: dict[str, Any]) -> tuple[str, ...]:
    """Return the differences from the files listed in ``run.json``."""
    problems = []
    for name, known in info.get("files", {}).items():
        path = folder / name
        shown = path.as_posix()
        try:
            actual = run_json.file_facts(path)
        except FileNotFoundError:
            problems.append(f"{shown}: the file is missing")
        except OSError as problem:
            problems.append(f"{shown}: cannot read the file: {problem.strerror}")
        else:
            if actual != known:
                problems.append(
                    f"{shown}: the file has changed since the run was closed "
                    f"({known['bytes']} bytes then, {actual['bytes']} now)"
                )
    return tuple(problems)
