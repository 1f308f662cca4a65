"""The lock of a run's folder: at most one program writes to it, and the system releases it at its end."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.regular import regular

if TYPE_CHECKING:
    from filelock import FileLock

LOCK_NAME: Final = "run.lock"
STATE_NAME: Final = "state.json"
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
        """Release the lock and remove the file; idempotent, never raises."""
        with suppress(OSError):
            self._lock.release(force=True)
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

    if _beats_elsewhere(folder):
        return None
    lock = FileLock(folder / LOCK_NAME, thread_local=False)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return None
    except OSError as problem:
        raise RigctlError(
            f"cannot write to the run's folder: {problem.strerror}",
            where=Location(folder),
            exit_code=ExitCode.FAILED,
        ) from problem
    return FolderLock(lock)


def lock_folder(folder: Path) -> FolderLock:
    """Lock a run's folder.

    Raises
    ------
    RigctlError
        a running program has the lock, or the folder is not writable.
    """
    lock = try_lock(folder)
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
        return _beats_elsewhere(folder)
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
        """Whether the next heartbeat is not overdue."""
        return self.age <= FRESH


def read_state(folder: Path) -> RunState | None:
    """Read the last heartbeat of a run; None if there is none, or it is just being written."""
    path = folder / STATE_NAME
    try:
        age = time.time() - path.stat().st_mtime
        with open(path, "rb", opener=regular) as file:
            fields = json.loads(file.read().decode("utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(fields, dict):
        return None
    return RunState(fields, age)


def _beats_elsewhere(folder: Path) -> bool:
    """Return whether another computer, whose lock may not be visible here, writes to the folder."""
    state = read_state(folder)
    return state is not None and state.fresh and state.host not in ("", platform.node())
