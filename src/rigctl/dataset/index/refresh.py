"""Updates an index from the folders of the runs.

The modification time of a folder shows whether anything in it is new: `rigctl.dataset.run_json.write_info`
touches the folder that contains a run, and so does creating or removing a run. This does not reveal changes
that other programs make inside a run: some of the runs in unchanged folders are checked each time, and all of
them once one has changed.
"""

from __future__ import annotations

import logging
import os
import random
import sqlite3
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rigctl.dataset.day_folders import is_shard
from rigctl.dataset.index.rows import ChannelRange, FileState, Row, file_state, read_row
from rigctl.dataset.index.schema import INNER_COLUMNS, RUN_COLUMNS, quoted

logger = logging.getLogger(__name__)

#: key of the runs folder itself, among the folders of days
ROOT: Final = ""
#: a folder modified more recently than this may change again with the same time stamp, ns
_UNSETTLED: Final = 3_000_000_000
#: number of runs in unchanged folders that are checked each time
_SAMPLE: Final = 1000
#: runs read per transaction: the loss by an interrupt
_BATCH: Final = 2000
#: reading threads, so that one computes while another waits for the disk. Where nothing waits they take
#: twice the CPU time of one thread, since only one of them computes at a time.
_READERS: Final = 4
#: runs of a batch that are read first, to see whether reading waits for the disk
_FEW: Final = 100
#: share of the time that one thread computes, above which it reads alone
_BUSY: Final = 0.7
#: number of runs that one of several threads reads at a time
_TASK: Final = 20
_COLUMNS: Final = (*RUN_COLUMNS, *INNER_COLUMNS)
_NOTHING: Final[dict[str, Any]] = dict.fromkeys(_COLUMNS)
_INSERT: Final = f"INSERT INTO run (key, {quoted(_COLUMNS)}) VALUES (?{', ?' * len(_COLUMNS)})"  # noqa: S608
#: number of runs from which reading them is logged
_LONG: Final = 20_000


@dataclass
class _Changes:
    """The differences between folders and index: runs to read, removed runs, the folders' times."""

    read: dict[tuple[str, str], FileState] = field(default_factory=dict)
    gone: list[tuple[str, str]] = field(default_factory=list)
    times: dict[str, int] = field(default_factory=dict)
    gone_folders: list[str] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.read or self.gone or self.times or self.gone_folders)


def refresh(index: sqlite3.Connection, runs: Path, *, channels: bool = True) -> None:
    """Update the index from the folders; unchanged runs are not read.

    May be interrupted, and run by several programs at once: unfinished folders are checked again.
    """
    # 1. Folders that were touched since: every run in them is compared by size and time of its `run.json`.
    known: dict[str, int] = dict(index.execute("SELECT name, mtime FROM shard"))
    changes = _Changes()
    present = _folders(runs, known)
    for name in present:
        _compare(index, runs, name, known.get(name), changes)
    changes.gone_folders = [name for name in known if name not in present]
    for name in changes.gone_folders:
        rows = index.execute("SELECT shard, id FROM run WHERE shard = ?", [name])
        changes.gone += rows.fetchall()
    # 2. Folders that look unchanged: a random part of their runs is checked. One that was changed behind our
    #   back means that the times of folders cannot be trusted here, and all are compared.
    settled = {name for name in present if name not in changes.times}
    if settled and _changed_unseen(index, runs, settled):
        for name in settled:
            _compare(index, runs, name, None, changes)
    # 3. Runs that were in progress may have ended, or been killed, without any file changing.
    _look_at_open(index, runs, changes)
    if changes:
        _apply(index, runs, changes, channels=channels)


def _folders(runs: Path, known: dict[str, int]) -> list[str]:
    """Return the runs folder itself and the folders of days in it."""
    try:
        if known.get(ROOT) == runs.stat().st_mtime_ns:
            return list(known)
        with os.scandir(runs) as entries:
            return [ROOT, *(entry.name for entry in entries if is_shard(entry.name) and entry.is_dir())]
    except (FileNotFoundError, NotADirectoryError):
        return []


def _compare(index: sqlite3.Connection, runs: Path, name: str, known: int | None, changes: _Changes) -> None:
    """Check every run of a folder, unless its modification time is unchanged."""
    folder = runs / name
    try:
        changed = folder.stat().st_mtime_ns  # read before its entries, since later changes modify it again
        if changed == known:
            return
        with os.scandir(folder) as entries:
            names = [entry.name for entry in entries]
    except FileNotFoundError:
        return  # just removed, which modifies the containing folder
    rows = {
        run_id: FileState(size, mtime)
        for run_id, size, mtime in index.execute("SELECT id, size, mtime FROM run WHERE shard = ?", [name])
    }
    for run_id in names:
        if run_id.startswith(".") or (name == ROOT and is_shard(run_id)):
            continue
        state = file_state(f"{folder}{os.sep}{run_id}")
        if state is not None and rows.pop(run_id, None) != state:
            changes.read[name, run_id] = state
    changes.gone += [(name, run_id) for run_id in rows if file_state(folder / run_id) is None]
    # Kept only once it is old: a second change within the resolution of the file system would have the same
    # time.
    time_kept = changed if changed < time.time_ns() - _UNSETTLED else -1
    if time_kept != known:
        changes.times[name] = time_kept


def _changed_unseen(index: sqlite3.Connection, runs: Path, settled: set[str]) -> bool:
    """Return whether one of some runs in unchanged folders has been changed by another program."""
    (last,) = index.execute("SELECT max(key) FROM run").fetchone()
    start = random.randrange((last or 0) + 1)  # noqa: S311 - not for cryptography
    columns = "SELECT shard, id, size, mtime FROM run WHERE key"
    rows = index.execute(f"{columns} >= ? ORDER BY key LIMIT ?", [start, _SAMPLE]).fetchall()
    if len(rows) < _SAMPLE:
        rows += index.execute(f"{columns} < ? LIMIT ?", [start, _SAMPLE - len(rows)]).fetchall()
    return any(
        shard in settled and file_state(_folder(runs, shard, run_id)) != (size, mtime)
        for shard, run_id, size, mtime in rows
    )


def _look_at_open(index: sqlite3.Connection, runs: Path, changes: _Changes) -> None:
    """Check runs in progress and abandoned runs, which may end without a change of any file."""
    for shard, run_id, status in index.execute("SELECT shard, id, status FROM run WHERE open").fetchall():
        folder = _folder(runs, shard, run_id)
        state = file_state(folder)
        if state is None or (shard, run_id) in changes.read:
            continue
        if read_row(folder, shard, state, channels=False).values["status"] != status:
            changes.read[shard, run_id] = state


def _apply(index: sqlite3.Connection, runs: Path, changes: _Changes, *, channels: bool) -> None:
    """Read the changes, and store them in batches; folders are marked as checked at the end."""
    if len(changes.read) >= _LONG:
        logger.warning("reading %d runs for the index of %s, once", len(changes.read), runs)
    # Marked as unchecked before the first row is stored: an interrupt leaves folders that are compared again.
    with transaction(index):
        unfinished = [(name, -1) for name in changes.times]
        index.executemany("INSERT OR REPLACE INTO shard VALUES (?, ?)", unfinished)
    # in the order of the index: unsorted, each batch changes pages all over it, ever more as it grows
    wanted = sorted(changes.read.items())
    for rows in _rows(runs, wanted, channels=channels):
        with transaction(index):
            remove_rows(index, [(row.values["shard"], row.values["id"]) for row in rows])
            insert_rows(index, rows)
    with transaction(index):
        remove_rows(index, changes.gone)
        index.executemany("INSERT OR REPLACE INTO shard VALUES (?, ?)", list(changes.times.items()))
        index.executemany("DELETE FROM shard WHERE name = ?", [(name,) for name in changes.gone_folders])


def _rows(
    runs: Path, wanted: Sequence[tuple[tuple[str, str], FileState]], *, channels: bool
) -> Iterator[list[Row]]:
    """The rows of these runs, batch by batch.

    If the first of a batch show that reading waits for the disk, the others are read by several threads.
    """

    def read(some: Sequence[tuple[tuple[str, str], FileState]]) -> list[Row]:
        return [
            read_row(_folder(runs, shard, run_id), shard, state, channels=channels)
            for (shard, run_id), state in some
        ]

    with ThreadPoolExecutor(_READERS, thread_name_prefix="rigctl-index") as pool:
        for start in range(0, len(wanted), _BATCH):
            batch = wanted[start : start + _BATCH]
            began, busy = time.perf_counter(), time.thread_time()
            # Whether reading waits for the disk is measured, not guessed: on a local disk one thread is as
            # fast as four.
            rows = read(batch[:_FEW])
            busy, took = time.thread_time() - busy, time.perf_counter() - began
            rest = batch[_FEW:]
            if busy > _BUSY * took:
                yield rows + read(rest)
                continue
            tasks = [pool.submit(read, rest[k : k + _TASK]) for k in range(0, len(rest), _TASK)]
            try:
                yield rows + [row for task in tasks for row in task.result()]
            finally:
                for task in tasks:
                    task.cancel()


def remove_rows(index: sqlite3.Connection, locations: Iterable[tuple[str, str]]) -> None:
    """Remove runs, by the folder's name and the id."""
    for location in locations:
        key = index.execute("SELECT key FROM run WHERE shard = ? AND id = ?", location).fetchone()
        if key is not None:
            index.execute("DELETE FROM channel WHERE run = ? AND name IN (SELECT key FROM channel_name)", key)
            index.execute("DELETE FROM run WHERE key = ?", key)


def insert_rows(index: sqlite3.Connection, rows: Sequence[Row]) -> None:
    """Insert new runs."""
    (last,) = index.execute("SELECT max(key) FROM run").fetchone()
    keyed = list(enumerate(rows, start=(last or 0) + 1))
    index.executemany(_INSERT, [(key, *(_NOTHING | row.values).values()) for key, row in keyed])
    insert_channels(index, [(key, row.channels) for key, row in keyed])


def insert_channels(index: sqlite3.Connection, runs: Iterable[tuple[int, Iterable[ChannelRange]]]) -> None:
    """Insert the ranges of the runs' columns, by the runs' keys."""
    names = {
        tuple(facts): key for key, *facts in index.execute("SELECT key, name, unit, kind FROM channel_name")
    }
    channels = []
    for key, ranges in runs:
        for channel in ranges:
            named = (channel.name, channel.unit, channel.kind)
            if named not in names:
                added = index.execute("INSERT INTO channel_name (name, unit, kind) VALUES (?, ?, ?)", named)
                names[named] = added.lastrowid
            channels.append((names[named], key, channel.low, channel.high))
    index.executemany("INSERT OR REPLACE INTO channel VALUES (?, ?, ?, ?)", channels)


@contextmanager
def transaction(index: sqlite3.Connection) -> Iterator[None]:
    """Commit everything written in the block, or nothing."""
    index.execute("BEGIN IMMEDIATE")
    try:
        yield
    except BaseException:
        index.execute("ROLLBACK")
        raise
    index.execute("COMMIT")


def _folder(runs: Path, shard: str, run_id: str) -> Path:
    return runs / shard / run_id
