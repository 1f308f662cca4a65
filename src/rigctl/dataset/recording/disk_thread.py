"""Writes to disk in a separate thread, so that a slow, full or missing disk never blocks a measurement.

Only this thread accesses the disk. Rows and events are queued in memory while the disk does not respond:
after `SLOW` s there is one warning, and after `STALLED` s or `_MOST` entries the run must end. What could not
be written to the run's folder is then written to another one, see `rescue_roots`.

The run's thread appends tasks to a deque, the storage thread takes them from its front; nothing else is
handed over but a few attributes that one side writes and the other reads (`_began`, `_failure`,
`_in_progress`), each replaced as a whole, so that no lock is needed. A task is removed from the queue
only after it has been carried out: should the thread hang in it for ever, `_leave_behind` finds it there,
and finishes the work from the run's thread on another disk. From then on the hanging thread must write
nothing any more (`_superseded`). See docs/decisions/0043-separate-disk-thread-with-fallback-folder.md.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any, Final

from rigctl.dataset.recording.writer import RunWriter
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.plan.measured import MeasuredValue

SLOW: Final = 2.0  #: s without a response of the disk before a warning
STALLED: Final = 30.0  #: s without a response before the run must end
_MOST: Final = 200_000  # queued rows and events at most; about 100 MB for ten channels
_LOOK: Final = 0.05  # s that the thread sleeps when idle
_IN_PLACE: Final = 0.5  # s between two checks that the folder still exists
_CLOSES_WITHIN: Final = 600.0  # s allowed for making the tables of a long run

_Task = Callable[[RunWriter], object]


class BackgroundWriter:
    """A recorder with the methods of a `RunWriter`; each returns at once.

    The first call after the disk has failed or stalled raises; later data are kept all the same.

    Parameters
    ----------
    writer: the writer, which must not be used by anything else from now on.
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
        self._began: float | None = None  # start of the task in progress
        self._in_progress: _Task | None = None  # the head of the queue once it has been started
        self._stuck: RunWriter | None = None
        self._abandoned = False  # the thread hangs, and its work was done elsewhere
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
        """Begin a record; return its index in the run."""
        if self._record >= 0:
            raise ValueError(f"record {self._record} is still open")
        # The index is known at once, without the disk: the next row already carries it.
        self._record = self._next_record
        self._next_record += 1
        self._put(lambda writer: writer.open_record(time, name, sweep, path, rate))
        return self._record

    def measure(self, value: MeasuredValue) -> None:
        """Store a value with the open record, or with the run."""
        self._put(lambda writer: writer.measure(value))

    def close_record(self, time: float, outcome: str, missing: float = 0.0) -> None:
        """End the open record."""
        if self._record < 0:
            raise ValueError("no record is open")
        self._record = -1
        self._put(lambda writer: writer.close_record(time, outcome, missing))

    def warnings(self) -> list[str]:
        """Return the warnings about the disk since the last call."""
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
        warnings = list(self._warnings)
        self._warnings.clear()
        return warnings

    def close(self, status: str, reason: str | None = None, unconfirmed: str | None = None) -> Path:
        """End the session and make the run's tables. Waits as long as the disk makes progress; idempotent.

        Raises
        ------
        RigctlError
            something could not be written to the run's folder; names the folder that has it.
        """
        if self._ended:
            return self.folder
        self._ended = True
        self._closing = (status, reason, unconfirmed)
        # The last task: the queue is worked off in order, so that everything is written before the tables are
        # made.
        self._tasks.append(self._finish)
        self._wake.set()
        # Measured since the beginning of the task in progress, not since `close`: a disk that makes progress
        # may take as long as it needs. Making the tables is one task, of a long run a long one, with a limit
        # of its own.
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

    # --- implementation -----------------------------------------------------------------------------------

    def _put(self, task: _Task) -> None:
        self._tasks.append(task)
        # Raised once: the run then ends, and its last rows and events are kept all the same.
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
        """Return the duration of the task in progress so far, s."""
        began = self._began
        return 0.0 if began is None else monotonic() - began

    def _work(self) -> None:
        """Run the tasks of the queue one after the other (the thread's target)."""
        looked = monotonic()
        while True:
            now = monotonic()
            # Writing to a deleted file succeeds; only looking shows that the folder is gone.
            if now >= looked + _IN_PLACE:
                looked = now
                self._guarded(self._require_place)
                if self._superseded(self._writer):
                    return
            if not self._tasks:
                if self._ended:
                    return
                self._guarded(RunWriter.show)
                if self._superseded(self._writer):
                    return
                self._wake.wait(_LOOK)
                continue
            # Left in the queue while it is carried out, see the beginning of this module.
            task = self._in_progress = self._tasks[0]
            self._guarded(task)
            if self._superseded(self._writer):
                return
            self._tasks.popleft()
            self._in_progress = None

    def _guarded(self, task: _Task) -> None:
        self._began = monotonic()
        try:
            task(self._writer)
        except RigctlError as error:
            self._failure = self._failure or error
        except Exception as error:  # noqa: BLE001 - any error must reach the run
            self._failure = self._failure or RigctlError(
                f"the samples cannot be kept: {error!r}",
                where=Location(self._writer.folder),
                exit_code=ExitCode.FAILED,
            )
        finally:
            self._began = None

    def _require_place(self, writer: RunWriter) -> None:
        """Continue in another folder once the run's folder is gone: data written there are lost."""
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
        failure = str(self._failure) if self._failure is not None else ""
        if failure and failure not in (reason or ""):
            reason = f"{reason}; {failure}" if reason else failure
            status = "failed" if status == "finished" else status
        writer.close(status, reason, unconfirmed)

    def _rescue(self, writer: RunWriter, why: str) -> None:
        """Continue in another folder, with everything that can be read back."""
        self._writer = _elsewhere(writer, read_back=True)
        writer.release()
        self._failure = _kept_elsewhere(why, writer.folder, self._writer.folder)
        # The run may have been told of an earlier failure; that its data go elsewhere has to be said too.
        self._told = False

    def _superseded(self, successor: RunWriter) -> bool:
        """Return whether the work was done elsewhere while the thread hung; its files are then released."""
        if not self._abandoned:
            return False
        if self._stuck is not None and self._stuck is not successor:
            self._stuck.release()
        return True

    def _leave_behind(self) -> None:
        """Write what a hanging disk has not accepted to another folder, from the calling thread."""
        current, stuck, tasks = self._in_progress, self._writer, list(self._tasks)
        self._stuck, self._abandoned = stuck, True
        # All samples were passed on before `close` was called; the tables can be made again at any time.
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
            # the data of the task in progress are still in the writer's buffer
            if task is current or task == self._finish:
                continue
            with suppress(Exception):  # one failure must not prevent the following tasks
                task(writer)
        try:
            self._close(writer)
        except RigctlError as error:
            self._failure = error


def _elsewhere(writer: RunWriter, *, read_back: bool) -> RunWriter:
    """Make a successor in the first fallback folder that is writable."""
    problem: Exception | None = None
    for root in rescue_roots():
        try:
            return writer.successor(root / writer.id, read_back=read_back)
        except (RigctlError, OSError) as error:
            problem = error
    raise problem or OSError("no folder to write to")


def rescue_roots() -> list[Path]:
    """Return the fallback folders for samples: the user's data folder, then a temporary one."""
    from tempfile import gettempdir

    from platformdirs import user_data_path

    return [user_data_path("rigctl", appauthor=False) / "rescued", Path(gettempdir()) / "rigctl-rescued"]


def _kept_elsewhere(why: str, before: Path, folder: Path) -> RigctlError:
    return RigctlError(
        f"{why}; samples are kept in {folder.as_posix()} instead",
        hint=f"'rigctl runs verify {folder.as_posix()}' shows what is there",
        where=Location(before),
        exit_code=ExitCode.FAILED,
    )
