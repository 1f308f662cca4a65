"""Keeps a disk that is slow, full or gone from holding up whoever measures.

Rows and events are handed to a thread that alone touches the disk. They wait in memory while it does not
answer: `SLOW` s later that is said once, after `STALLED` s or `_MOST` entries the run has to end. What could
not be written to the run's folder then goes to another one, see `rescue_roots`.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any, Final

from rigctl.dataset.writer import RunWriter
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.plan.measured import MeasuredValue

SLOW: Final = 2.0  #: s without an answer of the disk, after which that is said
STALLED: Final = 30.0  #: s, after which the run has to end
_MOST: Final = 200_000  # rows and events that may wait in memory; about 100 MB of ten channels
_LOOK: Final = 0.05  # s of the thread's sleep when nothing is to be done
_IN_PLACE: Final = 0.5  # s between two looks whether the folder is still there
_CLOSES_WITHIN: Final = 600.0  # s for the tables of a long run

_Task = Callable[[RunWriter], object]


class BackgroundWriter:
    """A recorder with the methods of a `RunWriter`; each returns at once.

    The call after the disk has failed, or has stalled, raises, once; what comes later is kept all the same.

    Parameters
    ----------
    writer: what writes; nobody else may use it any more.
    """

    def __init__(self, writer: RunWriter) -> None:
        self._writer = writer
        self._tasks: deque[_Task] = deque()
        self._record = writer.record
        self._next_record = writer.next_record
        self._last_time = 0.0
        self._failure: RigctlError | None = None
        self._told = False
        self._warnings: deque[str] = deque()
        self._slow = False
        self._began: float | None = None  # when the task in progress was begun
        self._in_progress: _Task | None = None  # the one at the queue's head once it was begun
        self._stuck: RunWriter | None = None
        self._abandoned = False  # the thread hangs, and somebody else writes
        self._ended = False
        self._closing: tuple[str, str | None, str | None] = ("failed", None, None)
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._work, name="storage", daemon=True)
        self._thread.start()

    @property
    def id(self) -> str:
        """The run's id."""
        return self._writer.id

    @property
    def folder(self) -> Path:
        """The run's folder; another one after a rescue."""
        return self._writer.folder

    @property
    def record(self) -> int:
        """Index of the open record; −1 between records."""
        return self._record

    def append(self, row: Sequence[float]) -> None:
        """Add one sample."""
        self._put(lambda writer: writer.append(row))

    def event(self, time: float, kind: str, **fields: Any) -> None:
        """Log something that happened."""
        self._put(lambda writer: writer.event(time, kind, **fields))

    def open_record(
        self, time: float, name: str, sweep: Mapping[str, tuple[float, str]], path: str, rate: float
    ) -> int:
        """Begin a record; its index in the run."""
        if self._record >= 0:
            raise ValueError(f"record {self._record} is still open")
        self._record = self._next_record
        self._next_record += 1
        self._put(lambda writer: writer.open_record(time, name, sweep, path, rate))
        return self._record

    def measure(self, value: MeasuredValue) -> None:
        """Keep a value with the open record, or with the run."""
        self._put(lambda writer: writer.measure(value))

    def close_record(self, time: float, outcome: str) -> None:
        """End the open record."""
        if self._record < 0:
            raise ValueError("no record is open")
        self._record = -1
        self._put(lambda writer: writer.close_record(time, outcome))

    def warnings(self) -> list[str]:
        """What is to be said of the disk since the last call."""
        age = self._age()
        if age > SLOW and not self._slow:
            self._slow = True
            waiting = len(self._tasks)
            self._warnings.append(
                f"the disk has not answered for {age:.1f} s; {waiting} samples and events wait in memory, "
                f"and the run ends after {STALLED:g} s of that"
            )
        elif self._slow and age < SLOW:
            self._slow = False
            self._warnings.append("the disk answers again, nothing is lost")
        found = list(self._warnings)
        self._warnings.clear()
        return found

    def close(self, status: str, reason: str | None = None, unconfirmed: str | None = None) -> Path:
        """End the session and make the run's tables. Waits while the disk gets on; idempotent.

        Raises
        ------
        RigctlError
            not all could be written to the run's folder; names where it is.
        """
        if self._ended:
            return self.folder
        self._ended = True
        self._closing = (status, reason, unconfirmed)
        self._tasks.append(self._finish)
        self._wake.set()
        give_up = STALLED
        while self._thread.is_alive():
            self._thread.join(_LOOK)
            if not self._tasks:
                give_up = _CLOSES_WITHIN
            if self._age() > give_up:
                self._leave_behind()
                break
        if self._failure is not None:
            raise self._failure
        return self.folder

    # --- inside -------------------------------------------------------------------------------------------

    def _put(self, task: _Task) -> None:
        self._tasks.append(task)
        if self._told:
            return
        if self._failure is None and (self._age() > STALLED or len(self._tasks) > _MOST):
            self._failure = RigctlError(
                f"the disk has not answered for {self._age():.0f} s",
                hint="What was measured meanwhile is kept in memory until the run is closed",
                where=Location(self._writer.folder),
                exit_code=ExitCode.FAILED,
            )
        if self._failure is not None:
            self._told = True
            raise self._failure

    def _age(self) -> float:
        """For how long the task in progress has been going on, s."""
        began = self._began
        return 0.0 if began is None else monotonic() - began

    def _work(self) -> None:
        """The thread: one task after the other."""
        looked = monotonic()
        while True:
            now = monotonic()
            if now >= looked + _IN_PLACE:
                looked = now
                self._guarded(self._require_place)
                if self._left_behind(self._writer):
                    return
            if not self._tasks:
                if self._ended:
                    return
                self._guarded(RunWriter.show)
                if self._left_behind(self._writer):
                    return
                self._wake.wait(_LOOK)
                continue
            task = self._in_progress = self._tasks[0]
            self._guarded(task)
            if self._left_behind(self._writer):
                return
            self._tasks.popleft()
            self._in_progress = None

    def _guarded(self, task: _Task) -> None:
        self._began = monotonic()
        try:
            task(self._writer)
        except RigctlError as error:
            self._failure = self._failure or error
        except Exception as error:  # noqa: BLE001 - whatever it is, the run has to learn of it
            self._failure = self._failure or RigctlError(
                f"the samples cannot be kept: {error!r}",
                where=Location(self._writer.folder),
                exit_code=ExitCode.FAILED,
            )
        finally:
            self._began = None

    def _require_place(self, writer: RunWriter) -> None:
        """Go on elsewhere as soon as the run's folder is gone: what is written there reaches nobody."""
        if not self._ended and not writer.in_place():
            self._rescue(writer, "the run's folder is gone")

    def _finish(self, writer: RunWriter) -> None:
        if not writer.in_place():
            self._rescue(writer, "the run's folder is gone")
        else:
            try:
                writer.flush()
            except RigctlError as error:
                self._rescue(writer, error.what)
        self._close(self._writer)

    def _close(self, writer: RunWriter) -> None:
        status, reason, unconfirmed = self._closing
        said = str(self._failure) if self._failure is not None else ""
        if said and said not in (reason or ""):
            reason = f"{reason}; {said}" if reason else said
            status = "failed" if status == "finished" else status
        writer.close(status, reason, unconfirmed)

    def _rescue(self, writer: RunWriter, why: str) -> None:
        """Go on in another folder, with everything that can be read back."""
        self._writer = _elsewhere(writer, read_back=True)
        writer.release()
        self._failure = _kept_elsewhere(why, writer.folder, self._writer.folder)
        self._told = False

    def _left_behind(self, successor: RunWriter) -> bool:
        """Whether somebody else has done the thread's work while it hung; what it held is let go then."""
        if not self._abandoned:
            return False
        if self._stuck is not None and self._stuck is not successor:
            self._stuck.release()
        return True

    def _leave_behind(self) -> None:
        """The disk hangs for good: what it has not taken goes to another folder, from this thread."""
        begun, stuck, tasks = self._in_progress, self._writer, list(self._tasks)
        self._stuck, self._abandoned = stuck, True
        if stuck.closed:
            self._failure = RigctlError(
                "the disk does not answer; all samples were written, the run's tables are not made",
                hint=f"'rigctl runs verify {stuck.id}' makes them once it does",
                where=Location(stuck.folder),
                exit_code=ExitCode.FAILED,
            )
            return
        try:
            writer = self._writer = _elsewhere(stuck, read_back=False)
        except (RigctlError, OSError) as error:
            self._failure = RigctlError(
                f"the disk does not answer, and what was measured last could not be kept elsewhere: {error}",
                where=Location(stuck.folder),
                exit_code=ExitCode.FAILED,
            )
            return
        self._failure = _kept_elsewhere("the disk does not answer", stuck.folder, writer.folder)
        for task in tasks:
            # what the one in progress had to write waits in the writer's own memory
            if task is begun or task == self._finish:
                continue
            with suppress(Exception):  # one that fails must not take those after it along
                task(writer)
        try:
            self._close(writer)
        except RigctlError as error:
            self._failure = error


def _elsewhere(writer: RunWriter, *, read_back: bool) -> RunWriter:
    """A successor in the first fallback folder that can be written to."""
    problem: Exception | None = None
    for root in rescue_roots():
        try:
            return writer.successor(root / writer.id, read_back=read_back)
        except (RigctlError, OSError) as error:
            problem = error
    raise problem or OSError("no folder to write to")


def rescue_roots() -> list[Path]:
    """Where samples go that their run's folder cannot take: the user's data folder, or a temporary one."""
    from tempfile import gettempdir

    from platformdirs import user_data_path

    return [user_data_path("rigctl", appauthor=False) / "rescued", Path(gettempdir()) / "rigctl-rescued"]


def _kept_elsewhere(why: str, before: Path, folder: Path) -> RigctlError:
    return RigctlError(
        f"{why}; samples are kept in {folder} instead",
        hint=f"'rigctl runs verify {folder}' shows what is there",
        where=Location(before),
        exit_code=ExitCode.FAILED,
    )
