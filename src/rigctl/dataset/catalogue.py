"""Finding runs in the folder that holds them.

In: an id, the beginning of one, `latest`, or a condition. Out: folders, or one line for each run, from
``run.json`` alone. Few runs are read one by one; of many the index is asked, which is brought up to date
first (`rigctl.dataset.index.file`). Runs that are only in storage are listed beside the local ones, which
take precedence.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

from rigctl.dataset.day_folders import places_of
from rigctl.dataset.index.file import ask, ask_stored, is_indexed
from rigctl.dataset.index.rows import DAMAGED, facts_of
from rigctl.dataset.index.select import select, select_page
from rigctl.dataset.run_id import LATEST, SeveralRuns, chosen_id
from rigctl.dataset.run_json import NAME as RUN_JSON
from rigctl.dataset.run_json import read_info
from rigctl.dataset.run_order import is_run, run_folders
from rigctl.dataset.run_status import status_of
from rigctl.dataset.storage.store import Store, StoredFolder
from rigctl.errors import RigctlError
from rigctl.project import find_project, is_address

__all__ = ["LATEST", "RunSummary", "find_run", "list_runs", "run_folders", "runs_folder", "status_of"]

#: newest runs among which the nearest name is searched
_NEAREST: Final = 1000


@dataclass(frozen=True)
class RunSummary:
    """One row of the catalogue, from ``run.json`` alone.

    `status` is ``running`` for a run in progress and ``unclosed`` for one that its program left behind
    (``rigctl runs verify`` recovers it); ``damaged`` when ``run.json`` cannot be read. `test` is ``pass``,
    ``fail``, ``incomplete`` or, where no measure has limits, ``none``. `unconfirmed` names
    outputs that may still have been on at the end.
    """

    id: str
    folder: Path | StoredFolder
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
    unconfirmed: str = ""


#: the facts of a run's row that its summary takes
_TAKEN: Final = tuple(fact.name for fact in fields(RunSummary) if fact.name != "folder")


def runs_folder(runs: Path | None = None) -> Path:
    """Return the runs folder: the project's unless one is given."""
    return find_project().runs if runs is None else runs


def list_runs(
    runs: str | Path | None = None,
    *,
    where: str | None = None,
    last: int | None = None,
    stored: bool = True,
) -> list[RunSummary]:
    """List the runs, oldest first. One small file per run is read; with an index only changed ones.

    Parameters
    ----------
    runs: the folder, or the address in storage; by default those of the project.
    where: a condition: an expression in SQLite's SQL over the columns of `runs sql`, ``notes`` and
        ``excluded``. The ranges of the channels are in ``channels``: ``id IN (SELECT run
        FROM channels WHERE name = 'oil_temperature' AND high > 60)``, in the unit they were recorded in.
    last: number of newest runs to return.
    stored: False omits runs that are only in the project's storage.

    Raises
    ------
    RigctlError
        the condition is wrong, or the storage does not respond.
    """
    if is_address(runs):
        return list_stored(Store(str(runs)), where, last)
    folder = runs_folder(Path(runs) if runs is not None else None)
    store = find_project().store if runs is None and stored else None
    if store is not None:
        local = _list_local(folder, where, None)
        everything = local if where is None else _list_local(folder, None, None)
        others = list_stored(Store(store), where, None, but={run.id for run in everything})
        together = sorted([*local, *others], key=lambda run: run.id[:15])
        return together[-last:] if last else together
    return _list_local(folder, where, last)


def _list_local(folder: Path, where: str | None, last: int | None) -> list[RunSummary]:
    if where is None and not is_indexed(folder):
        folders = run_folders(folder)
        return list(_summaries(folders[-last:] if last else folders))
    rows = ask(folder, lambda index: select(index, where, last), channels=where is not None)
    return [_summary_of(folder, row) for row in rows]


def newest_folders(runs: Path | None = None, count: int = 50) -> list[Path]:
    """Return the folders of the newest local runs, oldest first."""
    folder = runs_folder(runs)
    if not is_indexed(folder):
        return run_folders(folder)[-count:]
    return [place_of(folder, row) for row in ask(folder, lambda index: select(index, last=count))]


@dataclass(frozen=True)
class CataloguePage:
    """A page of the local runs; `found` of `all` runs meet the condition."""

    runs: list[RunSummary]
    found: int
    all: int


def page_of_runs(runs: Path | None = None, *, where: str | None = None, **how: Any) -> CataloguePage:
    """Return a page of the catalogue, newest first, without runs that are only in storage.

    Parameters
    ----------
    runs: the folder; by default the project's.
    where: as in `list_runs`.
    how: options of `rigctl.dataset.index.select.select_page`.

    Raises
    ------
    RigctlError
        the condition is wrong, or there is no such column.
    """
    folder = runs_folder(runs)
    page = ask(folder, lambda index: select_page(index, where=where, **how), channels=where is not None)
    return CataloguePage([_summary_of(folder, row) for row in page.rows], page.found, page.all)


def list_stored(
    store: Store, where: str | None = None, last: int | None = None, *, but: Collection[str] = ()
) -> list[RunSummary]:
    """List the runs of a storage, oldest first, from an index that is updated first.

    Parameters
    ----------
    but: ids of runs to omit.

    Raises
    ------
    RigctlError
        the condition is wrong, or the storage does not respond.
    """
    channels = where is not None and "channels" in where
    rows = ask_stored(store, lambda index: select(index, where, None if but else last), channels=channels)
    summaries = [_summary_in(store.folder(row["id"]), row) for row in rows if row["id"] not in but]
    return summaries[-last:] if last else summaries


def _summary_of(runs: Path, row: Mapping[str, Any]) -> RunSummary:
    """Return the summary of one run from its row of the index."""
    return _summary_in(place_of(runs, row), row)


def _summary_in(folder: Path | StoredFolder, row: Mapping[str, Any]) -> RunSummary:
    if row["status"] == DAMAGED:
        return RunSummary(row["id"], folder, DAMAGED)
    facts = {**row, "started": row["started_as"]}
    return RunSummary(folder=folder, **{name: facts[name] for name in _TAKEN if facts[name] is not None})


def place_of(runs: Path, row: Mapping[str, Any]) -> Path:
    """Return the folder of a run in the index."""
    return runs / str(row["shard"]) / str(row["id"])


def _summaries(folders: list[Path]) -> Iterator[RunSummary]:
    for folder in folders:
        try:
            info = read_info(folder)
        except RigctlError:
            yield RunSummary(folder.name, folder, DAMAGED)
        else:
            facts = {**facts_of(info), "id": folder.name, "status": status_of(folder, info)}
            yield _summary_in(folder, facts)


def locate_run(ref: str | Path, runs: str | Path | None = None) -> Path | StoredFolder:
    """Find a run as `find_run` does, also in storage: at an address, or in the project's.

    Raises
    ------
    RigctlError
        there is no such run, or the start of the id is ambiguous.
    """
    if is_address(ref):
        address, _, name = str(ref).rstrip("/").removesuffix(f"/{RUN_JSON}").rpartition("/")
        return Store(address).find(name)
    if is_address(runs):
        return Store(str(runs)).find(str(ref))
    store = find_project().store if runs is None else None
    if store is None:
        return find_run(ref, Path(runs) if runs is not None else None)
    try:
        local = find_run(ref)
    except SeveralRuns:
        raise
    except RigctlError:
        return Store(store).find(str(ref))
    if str(ref) != LATEST:
        return local
    newest = Store(store).newest()
    return Store(store).folder(newest) if newest is not None and newest[:15] > local.name[:15] else local


def find_run(ref: str | Path, runs: Path | None = None) -> Path:
    """Return the folder of a run, given its id, an unambiguous start of it, a path, or ``latest``.

    Raises
    ------
    RigctlError
        there is no such run (names the nearest), the start of the id is ambiguous, or the run is in storage.
    """
    text = str(ref)
    if is_address(text):
        raise RigctlError(
            "a run in storage is only read",
            value=text,
            hint="Notes and recovery belong where it was recorded; 'rigctl runs upload' sends them after it",
        )
    as_path = Path(text)
    if text and is_run(as_path):
        return as_path.resolve()
    if as_path.name == RUN_JSON and as_path.is_file():
        return as_path.parent.resolve()
    folder = runs_folder(runs)
    for candidate in places_of(folder, text) if text and as_path.name == text else ():
        if is_run(candidate):
            return candidate
    return _by_start(text, folder, _known_folders(folder, text))


def _known_folders(runs: Path, text: str) -> list[Path]:
    """Return the candidate folders for the start of an id, oldest first."""
    if not is_indexed(runs):
        return run_folders(runs)
    begins = f"substr(id, 1, {len(text)}) = '{text.replace(chr(39), chr(39) * 2)}'"
    if text == LATEST or not re.fullmatch(r"[\w.-]+", text):
        rows = ask(runs, lambda index: select(index, last=1))
    else:
        rows = ask(runs, lambda index: select(index, begins) or select(index, last=_NEAREST))
    return [place_of(runs, row) for row in rows]


def _by_start(text: str, runs: Path, folders: list[Path]) -> Path:
    if not folders:
        raise RigctlError(
            f"there are no runs in {runs.as_posix()}", value=text, hint="'rigctl simulate' makes one"
        )
    by_id = {folder.name: folder for folder in folders}
    return by_id[chosen_id(text, list(by_id))]
