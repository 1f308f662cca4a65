"""The index on disk: used if there are many runs, updated before each use, bypassed if it fails.

It is stored in the user's cache, one file for each runs folder. A runs folder may be read-only, or on a
network whose locks are not reliable enough for SQLite; and it should contain only runs.

Nothing depends on it but time: whatever goes wrong with the file, the question is answered from an index
in memory. It may be used by several programs at once; SQLite's own locks keep them apart, and each brings
it up to date before it asks.
"""

from __future__ import annotations

import hashlib
import logging
import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias, TypeVar

from rigctl.dataset.day_folders import is_shard
from rigctl.dataset.index.refresh import refresh
from rigctl.dataset.index.schema import TABLES, VERSION
from rigctl.dataset.index.stored import refresh_stored
from rigctl.files.cache_folder import cache_folder
from rigctl.files.private import is_private, private_folder

if TYPE_CHECKING:
    from rigctl.dataset.storage.store import Store

logger = logging.getLogger(__name__)

#: number of runs from which the index is used; fewer are read one by one as fast
INDEX_FROM: Final = 1000
#: time-out for another program that writes to the index, s
_PATIENCE: Final = 10.0
T = TypeVar("T")
_Update: TypeAlias = Callable[[sqlite3.Connection], None]


def index_path(runs: Path) -> Path:
    """Return the index file of a runs folder."""
    name = hashlib.sha256(os.fsencode(runs.resolve())).hexdigest()[:24]
    return cache_folder() / "catalogue" / f"{name}.sqlite"


def stored_index_path(address: str) -> Path:
    """Return the index file of a storage."""
    return _path_of(address.encode())


def _path_of(location: bytes) -> Path:
    """The index file of the runs in one folder or storage."""
    return cache_folder() / "catalogue" / f"{hashlib.sha256(location).hexdigest()[:24]}.sqlite"


def is_indexed(runs: Path) -> bool:
    """Return whether there are enough runs for an index."""
    if index_path(runs).exists():
        return True
    count = 0
    try:
        with os.scandir(runs) as entries:
            for entry in entries:
                count += len(os.listdir(entry)) if is_shard(entry.name) else 1  # noqa: PTH208
                if count >= INDEX_FROM:
                    return True
    except OSError:
        return False
    return False


def ask(runs: Path, question: Callable[[sqlite3.Connection], T], *, channels: bool = True) -> T:
    """Return the result of `question` for an up-to-date index.

    For few runs, or if the file cannot be written, the index is made in memory and discarded. A damaged one,
    or one of another version, is rebuilt, with a warning of this module's logger.

    Parameters
    ----------
    channels: whether ranges of channels are needed; an index in memory omits them otherwise.
    """
    in_memory = lambda index: refresh(index, runs, channels=channels)  # noqa: E731
    if not is_indexed(runs):
        return _ask_memory(in_memory, question)
    path = index_path(runs)
    return _ask_kept(path, lambda index: refresh(index, runs), in_memory, question, "their folders")


def ask_stored(store: Store, question: Callable[[sqlite3.Connection], T], *, channels: bool) -> T:
    """Do as `ask` for the runs in a storage; its index is stored for any number of runs.

    Raises
    ------
    RigctlError
        the storage does not respond, or refuses: the earlier content of the index is not returned.
    """

    def up_to_date(index: sqlite3.Connection) -> None:
        refresh_stored(index, store, channels=channels)

    return _ask_kept(
        stored_index_path(store.address), up_to_date, up_to_date, question, "the objects in storage"
    )


def _ask_kept(path: Path, update: _Update, in_memory: _Update, question: Callable[..., T], truth: str) -> T:
    """Query the index in a file, rebuilt if it is damaged, and bypassed if it cannot be written.

    Parameters
    ----------
    update, in_memory: update the stored index, and one in memory.
    truth: what the index is derived from, for messages.
    """
    try:
        return _ask_file(path, update, question)
    # SQLite has one class for a busy file, a full disk and some kinds of damage: only the last is a reason to
    # make the index again.
    except sqlite3.OperationalError as problem:
        if _sound(path):
            logger.warning("the index of the runs cannot be used (%s); %s are read", problem, truth)
            return _ask_memory(in_memory, question)
        why = str(problem)
    except sqlite3.DatabaseError as problem:
        why = str(problem)
    except OSError as problem:
        logger.warning("no index of the runs can be kept (%s); %s are read", problem, truth)
        return _ask_memory(in_memory, question)
    logger.warning("the index of the runs is damaged (%s); it is made again from %s", why, truth)
    try:
        _remove_file(path)
        return _ask_file(path, update, question)
    except (sqlite3.DatabaseError, OSError) as problem:
        logger.warning("no index of the runs can be kept (%s); %s are read", problem, truth)
    return _ask_memory(in_memory, question)


def _remove_file(path: Path) -> None:
    for file in (path, path.with_name(f"{path.name}-journal")):
        file.unlink(missing_ok=True)


def _ask_file(path: Path, update: _Update, question: Callable[[sqlite3.Connection], T]) -> T:
    private_folder(path.parent)
    if path.exists():
        if not path.is_file():  # SQLite would wait for a pipe
            raise OSError(f"{path} is not a file")
        if not is_private(path):  # another user could read its rows
            _remove_file(path)
    with closing(sqlite3.connect(path, timeout=_PATIENCE, isolation_level=None)) as index:
        path.chmod(0o600)
        _prepare(index, path)
        update(index)
        return question(index)


def _ask_memory(update: _Update, question: Callable[[sqlite3.Connection], T]) -> T:
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as index:
        index.executescript(TABLES)
        update(index)
        return question(index)


def _prepare(index: sqlite3.Connection, path: Path) -> None:
    """Create the tables if missing; those of another version are dropped first."""
    (version,) = index.execute("PRAGMA user_version").fetchone()
    if version == VERSION:
        return
    index.execute("BEGIN EXCLUSIVE")
    try:
        (version,) = index.execute("PRAGMA user_version").fetchone()  # another program may have been first
        if version != VERSION:
            if version:
                logger.warning("%s is of version %d; it is made again", path, version)
            _clear(index)
            for statement in TABLES.split(";"):
                index.execute(statement)
    except BaseException:
        index.execute("ROLLBACK")
        raise
    index.execute("COMMIT")


def _clear(index: sqlite3.Connection) -> None:
    objects = index.execute("SELECT type, name FROM sqlite_master WHERE type IN ('table', 'view')").fetchall()
    for kind, name in sorted(objects, reverse=True):  # views before the tables that they use
        index.execute(f'DROP {kind} IF EXISTS "{name}"')


def _sound(path: Path) -> bool:
    """Return whether a file that failed is intact: busy, or on a full disk, but not damaged."""
    try:
        with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True, timeout=0)) as index:
            tables = {name for (name,) in index.execute("SELECT name FROM sqlite_master")}
    except sqlite3.OperationalError:
        return True
    except sqlite3.DatabaseError:
        return False
    return not path.exists() or not tables or {"run", "shard", "channel", "channel_name"} <= tables
