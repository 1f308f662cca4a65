"""The lock of a run's folder: at most one program writes to it, and the system releases it at its end.

Two signs show that a run is in progress, for two kinds of observers. On this computer it is a lock of the
operating system, which no kill can leave behind. Locks are not visible from another computer on many network
folders; there it is the heartbeat in ``state.json``, if it is fresh and comes from another host.

`annotations.lock` is a second, independent lock: notes are added while a run is in progress.
"""

from __future__ import annotations

import errno
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.regular import regular
from rigctl.json_values import parse_json

if TYPE_CHECKING:
    from filelock import FileLock

LOCK_NAME: Final = "run.lock"
ANNOTATIONS_LOCK_NAME: Final = "annotations.lock"
STATE_NAME: Final = "state.json"
#: time-out for a program that annotates a run, s
PATIENCE: Final = 10.0
#: how long a program that only checks whether the run is in progress may hold the lock, s
_BRIEF: Final = 0.2
#: s between two attempts
_PAUSE: Final = 0.01
#: attempts at a lock that is just being released
_TRIES: Final = 5
#: age from which a heartbeat of another computer means that its program has ended, s
FRESH: Final = 5.0


class FolderLock:
    """The lock for writing to a run's folder.

    The operating system releases it when the program ends for any reason; a killed program leaves no lock,
    and a step of the calendar clock does not break one.
    """

    def __init__(self, lock: FileLock) -> None:
        self._lock = lock

    def release(self) -> None:
        """Release the lock and remove the file; idempotent, never raises.

        The file is removed before the release, or another program could have locked it in between, and a
        third one lock a new file. Windows removes no open file, so that a file locked meanwhile remains.
        """
        if os.name == "posix" and self._lock.is_locked:
            self._remove()
        with suppress(OSError):
            self._lock.release(force=True)
        if os.name != "posix":
            self._remove()

    def _remove(self) -> None:
        with suppress(OSError):
            Path(self._lock.lock_file).unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def try_lock(folder: Path) -> FolderLock | None:
    """Lock a run's folder; return None if a running program has the lock.

    Raises
    ------
    RigctlError
        the folder cannot be written to.
    """
    from filelock import FileLock, Timeout

    if _written_elsewhere(folder):
        return None
    lock = FileLock(folder / LOCK_NAME, thread_local=False)
    try:
        # A lock file that is gone after a failed attempt was just being removed by its owner: it is tried
        # again.
        for remaining in reversed(range(_TRIES)):
            try:
                lock.acquire(timeout=0)
                break
            except Timeout:
                if not remaining or (folder / LOCK_NAME).exists():
                    return None  # otherwise it has just been released
    except OSError as problem:
        raise RigctlError(
            f"cannot write to the run's folder: {problem.strerror}",
            where=Location(folder),
            exit_code=ExitCode.FAILED,
        ) from problem
    return FolderLock(lock)


def wait_for_lock(
    folder: Path, patience: float, *, in_vain: Callable[[], bool] = lambda: False
) -> FolderLock | None:
    """Lock a run's folder, waiting at most `patience` seconds for another program; return None after that.

    `in_vain` returns whether there is no point in waiting any longer; it is called after every attempt.

    Raises
    ------
    RigctlError
        the folder cannot be written to.
    """
    deadline = time.monotonic() + patience
    while (lock := try_lock(folder)) is None:
        if in_vain() or time.monotonic() > deadline:
            return None
        time.sleep(_PAUSE)
    return lock


@contextmanager
def lock_annotations(folder: Path) -> Iterator[None]:
    """Lock the annotations of a run, which are also appended while the run is in progress; wait for others.

    Raises
    ------
    OSError
        the folder cannot be written to, or another program has the lock for long.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(folder / ANNOTATIONS_LOCK_NAME, thread_local=False)
    try:
        lock.acquire(timeout=PATIENCE, poll_interval=_PAUSE)
    except Timeout as problem:
        raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), lock.lock_file) from problem
    with FolderLock(lock):
        yield


def lock_folder(folder: Path) -> FolderLock:
    """Lock a run's folder.

    Raises
    ------
    RigctlError
        a running program has the lock, or the folder is not writable.
    """
    lock = wait_for_lock(folder, _BRIEF)
    if lock is None:
        raise RigctlError(
            "the run is in progress",
            value=folder.name,
            hint="Wait until it ends, or end it with 'rigctl abort'",
            exit_code=ExitCode.FAILED,
        )
    return lock


def in_progress(folder: Path) -> bool:
    """Return whether a program is writing to the run's folder."""
    if not (folder / LOCK_NAME).exists():
        return _written_elsewhere(folder)
    lock = try_lock(folder)
    if lock is None:
        return True
    lock.release()
    return False


@dataclass(frozen=True)
class RunState:
    """The latest heartbeat of a run's program in ``state.json``."""

    fields: Mapping[str, Any]
    age: float  #: age by the calendar clock, s

    @property
    def host(self) -> str:
        """The program's computer."""
        return str(self.fields.get("host") or "")

    @property
    def fresh(self) -> bool:
        """Whether the next heartbeat is not overdue; one of the future is as unlikely as one of the past."""
        return abs(self.age) <= FRESH


def read_state(folder: Path) -> RunState | None:
    """Read the last heartbeat of a run; None if there is none, or it is just being written."""
    path = folder / STATE_NAME
    try:
        age = time.time() - path.stat().st_mtime
        with open(path, "rb", opener=regular) as file:
            fields = parse_json(file.read().decode("utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(fields, dict):
        return None
    return RunState(fields, age)


def _written_elsewhere(folder: Path) -> bool:
    """Return whether another computer, whose lock may not be visible here, writes to the folder."""
    state = read_state(folder)
    return state is not None and state.fresh and state.host not in ("", platform.node())
