"""Finding runs in the folder that holds them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rigctl.dataset import journal, log, run_json
from rigctl.dataset.annotations import Annotation, excluded_records
from rigctl.dataset.history import INTERRUPTED
from rigctl.dataset.lock import in_progress
from rigctl.dataset.run_json import read_info
from rigctl.errors import RigctlError, nearest_name
from rigctl.project import find_project

#: how the newest run is called on the command line
LATEST: Final = "latest"


@dataclass(frozen=True)
class RunSummary:
    """One line of the catalogue, from ``run.json`` alone.

    `status` is ``running`` for a run in progress and ``unclosed`` for one that its program left behind
    (``rigctl runs verify`` recovers it); ``damaged`` when ``run.json`` cannot be read. `test` is ``pass``,
    ``fail``, ``incomplete`` or, where no measure has limits, ``none``.
    """

    id: str
    folder: Path
    status: str
    procedure: str = ""
    rig: str = ""
    source: str = ""
    started: str = ""
    duration: float | None = None
    records: int | None = None
    complete_records: int | None = None
    rows: int | None = None
    notes: int = 0
    excluded: int = 0
    serial_number: str = ""
    part: str = ""
    operator: str = ""
    test: str = ""


def runs_folder(runs: Path | None = None) -> Path:
    """The folder that holds the runs: the project's, unless one is given."""
    return find_project().runs if runs is None else runs


def run_folders(runs: Path) -> list[Path]:
    """The folders of all runs, oldest first; ids begin with their date and time, to the second."""
    if not runs.is_dir():
        return []
    by_second: dict[str, list[Path]] = {}
    for entry in sorted((entry for entry in runs.iterdir() if _is_run(entry)), key=_order):
        by_second.setdefault(entry.name[:15], []).append(entry)
    for together in by_second.values():
        if len(together) > 1:
            together.sort(key=_started)
    return [folder for together in by_second.values() for folder in together]


def _started(folder: Path) -> str:
    """When a run was made, to the microsecond; nothing where it cannot be read.

    The data of an import may have begun years before.
    """
    try:
        info = read_info(folder)
    except RigctlError:
        return ""
    return str(info.get("backend", {}).get("imported") or info.get("started", ""))


def _is_run(folder: Path) -> bool:
    """A run has lost ``run.json`` or its log at worst; a dot marks one that is just being made."""
    if folder.name.startswith("."):
        return False
    return (folder / run_json.NAME).is_file() or (folder / log.NAME).is_file()


def _order(folder: Path) -> tuple[str, int, str]:
    """By start, then in the order in which runs of one second were given their numbers."""
    stem, _, number = folder.name.rpartition("-")
    if number.isdigit() and stem and (folder.parent / stem).is_dir():
        return (stem[:15], int(number), folder.name)
    return (folder.name[:15], 1, folder.name)


def list_runs(runs: Path | None = None) -> list[RunSummary]:
    """All runs, oldest first. Reads one small file of each."""
    return list(_summaries(run_folders(runs_folder(runs))))


def _summaries(folders: list[Path]) -> Iterator[RunSummary]:
    for folder in folders:
        try:
            info = read_info(folder)
        except RigctlError:
            yield RunSummary(folder.name, folder, "damaged")
        else:
            yield summarise(folder, info)


def summarise(folder: Path, info: dict[str, Any]) -> RunSummary:
    """The line of one run."""
    said = [Annotation(**statement) for statement in info.get("annotations", ())]
    return RunSummary(
        id=folder.name,
        folder=folder,
        status=status_of(folder, info),
        procedure=info["procedure"]["name"],
        rig=info["rig"]["name"],
        source=info.get("source", ""),
        started=info["started"],
        duration=info.get("duration"),
        records=info.get("records"),
        complete_records=info.get("complete_records"),
        rows=info.get("rows"),
        notes=sum(statement.kind == "note" for statement in said),
        excluded=len(excluded_records(said)),
        serial_number=info.get("device", {}).get("serial_number", ""),
        part=info.get("device", {}).get("part", ""),
        operator=info.get("operator", ""),
        test=info.get("test", {}).get("result", ""),
    )


def status_of(folder: Path, info: dict[str, Any]) -> str:
    """The run's status, with a run in progress told from one that was left behind."""
    status = str(info["status"])
    if status != run_json.RUNNING and not (folder / journal.NAME).exists():
        return status
    return run_json.RUNNING if in_progress(folder) else "unclosed"


def find_run(ref: str | Path, runs: Path | None = None) -> Path:
    """The folder of the run that `ref` names: an id, an unambiguous start of one, a path, or ``latest``.

    Raises
    ------
    RigctlError
        there is no such run (names the nearest), or several ids begin like this.
    """
    text = str(ref)
    as_path = Path(text)
    if text and _is_run(as_path):
        return as_path.resolve()
    if as_path.name == run_json.NAME and as_path.is_file():
        return as_path.parent.resolve()
    folder = runs_folder(runs)
    folders = run_folders(folder)
    if not folders:
        raise RigctlError(f"there are no runs in {folder}", value=text, hint="'rigctl simulate' makes one")
    if text == LATEST:
        return folders[-1]
    return _by_start(text, folders)


def _by_start(text: str, folders: list[Path]) -> Path:
    by_id = {folder.name: folder for folder in folders}
    if text in by_id:
        return by_id[text]
    matches = [name for name in by_id if text and name.startswith(text)]
    if len(matches) == 1:
        return by_id[matches[0]]
    if matches:
        listed = ", ".join(matches[:6]) + (", …" if len(matches) > 6 else "")
        raise RigctlError("several runs begin like this", value=text, expected=f"one of {listed}")
    newest = list(by_id)[-1]
    raise RigctlError(
        "no such run",
        value=text,
        expected=f"an id such as {newest}, the start of one, a path, or '{LATEST}'",
        nearest=nearest_name(text, by_id),
    )


def unfinished(info: dict[str, Any]) -> bool:
    """True for a run that `rigctl resume` can go on with."""
    return info["status"] in (INTERRUPTED, "failed", "aborted")
