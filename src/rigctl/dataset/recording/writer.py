"""Records a run while it is in progress, so that its data survive however it ends.

Two append-only files are authoritative while a run is in progress: the journal of its samples and the log of
everything else. Both are passed to the operating system at least twice a second, and to the disk at the end
of a record and every ten seconds between records. `close` makes the run's tables from them, or later
`rigctl.dataset.verification`.

What has been passed to the operating system survives a kill of this program; what has been synchronised with
the disk also survives a power failure. A sync waits for the disk, and therefore happens where a wait disturbs
least. Between the two files the order matters: a record is in the log before its first sample can be on
disk, and its samples are written before the line that closes it; so no kill leaves samples without a record,
or a complete record without its samples.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import mkdtemp
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.day_folders import folder_for
from rigctl.dataset.history import read_history
from rigctl.dataset.recording import journal, log
from rigctl.dataset.recording.journal import JournalWriter
from rigctl.dataset.recording.log import LogWriter
from rigctl.dataset.recording.writer_lock import FolderLock, lock_folder
from rigctl.dataset.run_id import free_run_id
from rigctl.dataset.run_json import RUNNING, read_info, write_info
from rigctl.errors import ExitCode, Location, RigctlError, shorten
from rigctl.files.write import move_folder
from rigctl.plan.measured import MeasuredValue

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rigctl.dataset.recording.header import RunHeader

#: longest time that a row or an event is buffered, s of wall time
FLUSH_AFTER: Final = 0.5
#: delay for a concurrent reader when the writer is idle, s of wall time
SEEN_AFTER: Final = 0.08
#: limit of buffered blocks, bytes
_FLUSH_BYTES: Final = 1 << 21
#: shortest interval of disk syncs at the end of records, and interval between records, s of wall time
_SYNC_AFTER: Final = 1.0
_SYNC_BETWEEN: Final = 10.0


class RunWriter:
    """Writes one session of a run. Made by `create` or `reopen`; not thread-safe.

    All values are SI, all times seconds of this session's clock.

    If the disk is full or gone, the call that detects it raises once; later data are buffered, and `close`
    tries again.
    """

    def __init__(self, folder: Path, lock: FolderLock, header: RunHeader, session: _Session) -> None:
        self.folder = folder
        self.header = header
        self._lock = lock
        self._log = LogWriter(folder / log.NAME)
        self._journal = JournalWriter(
            folder / journal.NAME,
            header.layout.columns,
            {"run": header.id, "session": session.number, "offset": session.offset},
        )
        self._pack_row = self._journal.append
        self._session = session
        self._next_record = session.next_record
        self._record = -1
        self._record_rows = 0
        self._last_row: Sequence[float] = (0.0,)
        self._last_event = 0.0
        self._due = monotonic() + FLUSH_AFTER
        self._synced = monotonic()
        self._failure: RigctlError | None = None
        self._closed = False

    @classmethod
    def create(cls, runs: Path, header: RunHeader) -> RunWriter:
        """Begin a run in a new folder under `runs`.

        The folder is named ``header.id``, with a number appended if another program has just taken that name.

        Raises
        ------
        RigctlError
            the folder cannot be made or written to; nothing was created.
        """
        try:
            runs.mkdir(parents=True, exist_ok=True)
            folder = _make_folder(runs, header)
        except OSError as problem:
            raise RigctlError(
                f"cannot make a folder for the run: {problem.strerror}",
                where=Location(runs),
                hint="Choose another folder with 'runs = \"…\"' in rigctl.toml",
            ) from problem
        header = replace(header, id=folder.name)
        return _begin(folder, header, _Session())

    @classmethod
    def reopen(cls, folder: Path, header: RunHeader | None = None) -> RunWriter:
        """Continue an unfinished run: a new session in the same folder.

        Existing data are unchanged. A record that was open is marked ``interrupted``, and measured again
        under the next index. The run's time continues after its last sample.

        Parameters
        ----------
        header: of the new session; by default that of the run.

        Raises
        ------
        RigctlError
            the run is in progress or finished, or its columns differ from those of `header`.
        """
        from rigctl.dataset.recording.finalise import finalise

        # What the earlier session left is made into tables first: the journal's name is free for the new
        # session.
        with lock_folder(folder):
            finalise(folder)
        history = read_history(folder)
        began = history.header
        header = replace(header or began, id=began.id)
        if history.status == "finished":
            raise RigctlError("the run is finished; there is nothing to resume", value=began.id)
        if header.layout != began.layout:
            raise RigctlError(
                "the rig's channels or units have changed since the run began",
                value=", ".join(header.layout.columns),
                expected=", ".join(began.layout.columns),
            )
        # Run time goes on after the last sample, also if the calendar clock has been set back since.
        elapsed = (header.started - began.started).total_seconds()
        session = _Session(
            number=len(history.sessions),
            offset=max(elapsed, read_info(folder)["duration"] + 1.0),
            next_record=len(history.records),
        )
        return _begin(folder, header, session)

    @property
    def id(self) -> str:
        """The run's id, which is its folder's name."""
        return self.header.id

    @property
    def record(self) -> int:
        """Index of the open record, −1 between records; part of every row."""
        return self._record

    def append(self, row: Sequence[float]) -> None:
        """Add one sample, with values in the order of ``layout.columns``.

        Raises
        ------
        RigctlError
            the disk is full or gone.
        """
        self._pack_row(row)
        # Counted here and written with the closing line: that is how a lost sample is noticed when the tables
        # are made.
        self._record_rows += row[1] == self._record
        self._last_row = row
        if monotonic() >= self._due:
            self._flush_due()

    def append_block(self, rows: NDArray[np.float64]) -> None:
        """Add many samples at once, shape (n, columns)."""
        self._journal.append_block(rows)
        self._record_rows += int((rows[:, 1] == self._record).sum())
        if len(rows):
            self._last_row = (float(rows[-1, 0]),)
        if self._journal.waiting >= _FLUSH_BYTES or monotonic() >= self._due:
            self._flush_due()

    def event(self, time: float, kind: str, **fields: Any) -> None:
        """Log an event.

        Parameters
        ----------
        time: when, s.
        kind: ``state``, ``step``, ``command``, ``operator``, ``alarm``, ``note``, ``gap``, ``fault``, …
        fields: any other data. ``message`` and ``path`` (of the step) have separate columns; a ``command``
            has ``actuator``, ``value`` and ``uncertainty`` (of its time).
        """
        self._log.append({"time": time, "kind": kind, **fields})
        self._last_event = time
        if monotonic() >= self._due:
            self._flush_due()

    def open_record(
        self, time: float, name: str, sweep: Mapping[str, tuple[float, str]], path: str, rate: float
    ) -> int:
        """Begin a record.

        Parameters
        ----------
        sweep: its sweep variables: SI value and display unit.
        path: path of the record's step in the plan.
        rate: sampling rate, Hz.

        Returns
        -------
        Its index in the run, from 0.
        """
        if self._record >= 0:
            raise ValueError(f"record {self._record} is still open")
        index = self._next_record
        self._next_record += 1
        values = {key: [value, unit] for key, (value, unit) in sweep.items()}
        opened = {"state": "open", "record": index, "name": name, "path": path, "rate": rate}
        self.event(time, "record", **opened, sweep=values)
        try:
            if self._failure is None:
                self.flush()  # the log must have every record that samples on disk refer to
        finally:  # only now: the heartbeat, from another thread, names no record that a kill would lose
            self._record, self._record_rows = index, 0
        return self._record

    def measure(self, value: MeasuredValue) -> None:
        """Store a value with the open record, or with the run if none is open."""
        self.event(max(self._last_row[0], self._last_event), "measure", record=self._record, **asdict(value))

    def close_record(self, time: float, outcome: str, missing: float = 0.0) -> None:
        """End the open record: ``complete``, ``failed``, ``aborted``, …

        `missing` is the largest share that it lacks: of its samples, or of the readings of a channel.
        """
        if self._record < 0:
            raise ValueError("no record is open")
        closed = {"state": "closed", "record": self._record, "outcome": outcome}
        self._record = -1
        self.event(time, "record", **closed, rows=self._record_rows, missing=missing)
        if self._failure is None:
            self.flush(sync=monotonic() >= self._synced + _SYNC_AFTER)

    def flush(self, *, sync: bool = False) -> None:
        """Pass all rows and events to the operating system; with `sync`, wait for the disk.

        Raises
        ------
        RigctlError
            the disk is full or gone.
        """
        for file in (self._journal, self._log):  # a closed record must have all its samples
            try:
                file.flush()
                if sync:
                    file.sync()
            except OSError as problem:
                raise self._fail(file.path, problem) from problem
        self._failure = None
        self._due = monotonic() + FLUSH_AFTER
        if sync:
            self._synced = monotonic()

    def show(self) -> None:
        """Write what has been buffered for a moment, for concurrent readers; weaker than `flush`.

        Raises
        ------
        RigctlError
            the disk is full or gone.
        """
        if self._journal.waiting and monotonic() >= self._due - FLUSH_AFTER + SEEN_AFTER:
            self._flush_due()

    def close(self, status: str, reason: str | None = None, unconfirmed: str | None = None) -> Path:
        """End the session and make the run's tables, which completes the folder. Idempotent.

        Parameters
        ----------
        status: ``finished``, ``failed`` or ``aborted``.
        reason: why it did not finish.
        unconfirmed: outputs that may still be on, since the bench could not be reached at the end.

        Raises
        ------
        RigctlError
            the disk is full or gone, or memory is insufficient; what was written is kept, and ``rigctl runs
            verify`` continues from there.
        """
        if self._closed:
            return self.folder
        self._closed = True
        ended = max(self._last_row[0], self._last_event)
        if reason is None and self._journal_shortened():
            reason = "the journal was truncated while the run was in progress: samples are lost"
        doubt = {} if unconfirmed is None else {"unconfirmed": unconfirmed}
        self._log.append({"time": ended, "kind": "end", "status": status, "reason": reason} | doubt)
        try:
            try:
                self.flush(sync=True)
            finally:
                self._journal.close()
                self._log.close()
            self._make_tables()
        finally:
            self._lock.release()
        return self.folder

    def _journal_shortened(self) -> bool:
        try:
            return self._journal.shortened
        except OSError:  # `flush` will say what is wrong with the disk
            return False

    def _make_tables(self) -> None:
        """Make the tables; if this fails, they can be made from the journal later."""
        later = f"All that was measured is in its journal: 'rigctl runs verify {self.folder.name}' makes them"
        try:
            from rigctl.dataset.recording.finalise import finalise

            finalise(self.folder)
        except RigctlError as error:
            error.hint = error.hint or later
            raise
        except (MemoryError, ImportError, OSError, RuntimeError) as problem:
            # a memory limit may cause any of these: nothing can be loaded, mapped or started any more
            raise RigctlError(
                f"the tables of the run could not be made: {str(problem) or 'out of memory'}",
                hint=later,
                where=Location(self.folder),
                exit_code=ExitCode.FAILED,
            ) from problem

    @property
    def closed(self) -> bool:
        """Whether `close` has been called."""
        return self._closed

    def warnings(self) -> Sequence[str]:
        """Return no warnings about the disk, since the caller waits for it."""
        return ()

    @property
    def next_record(self) -> int:
        """Index of the next record."""
        return self._next_record

    def in_place(self) -> bool:
        """Return False if the run's folder was deleted, moved or unmounted."""
        return self._journal.in_place() and self._log.in_place()

    def successor(self, folder: Path, *, read_back: bool) -> RunWriter:
        """Return a writer that continues this session in another folder, which must not exist.

        Parameters
        ----------
        folder: with the same name as this run's.
        read_back: whether to copy what was written from the open files. If it cannot be read, or if the disk
            hangs, only buffered data are continued.

        Raises
        ------
        RigctlError, OSError
            that folder is not writable either.
        """
        folder.mkdir(parents=True)
        named = self.header.to_json()
        write_info(folder, {**named, "status": RUNNING, "reason": None})
        first_line = log.protected_line({"time": 0.0, "kind": "run", "header": named})
        (folder / log.NAME).write_bytes(first_line + b"\n")
        session = _Session(self._session.number, self._session.offset, self._next_record)
        writer = RunWriter(folder, lock_folder(folder), self.header, session)
        writer._journal.take_over(self._journal, read_back=read_back)
        # not a valid line, so that its content is counted as lost
        facts = {"time": 0.0, "kind": "session", **_session_facts(self.header, session)}
        gone = b"\n".join([first_line, log.protected_line(facts), b"(earlier lines)", b""])
        writer._log.take_over(self._log, read_back=read_back, otherwise=gone)
        writer._record, writer._record_rows = self._record, self._record_rows
        writer._last_row, writer._last_event = self._last_row, self._last_event
        return writer

    def release(self) -> None:
        """Release the files and the folder to a successor; never raises."""
        self._closed = True
        for file in (self._journal, self._log):
            with suppress(OSError):
                file.close()
        self._lock.release()

    def discard(self) -> None:
        """Delete a run that has just been made, with its folder, for imports that fail.

        Never raises; does nothing after a successful close.
        """
        self._closed = True
        self._journal.close()
        self._log.close()
        shutil.rmtree(self.folder, ignore_errors=True)
        self._lock.release()

    def _flush_due(self) -> None:
        if self._failure is None:
            idle = self._record < 0  # a wait for the disk would delay the samples of a record
            self.flush(sync=idle and monotonic() >= self._synced + _SYNC_BETWEEN)

    def _fail(self, path: Path, problem: OSError) -> RigctlError:
        self._failure = RigctlError(
            f"cannot write: {problem.strerror or problem}; what was written before is kept",
            hint=f"Make room, then 'rigctl runs verify {shorten(self.id)}'",
            where=Location(path),
            exit_code=ExitCode.FAILED,
        )
        return self._failure


class _Session:
    """The session of a writer: its number, and the offsets of its time and records."""

    def __init__(self, number: int = 0, offset: float = 0.0, next_record: int = 0) -> None:
        self.number = number
        self.offset = offset
        self.next_record = next_record


def _make_folder(runs: Path, header: RunHeader) -> Path:
    """Create a folder with the run's first files atomically.

    A folder cannot be renamed onto one with files in it, so that a name taken by another program at the same
    moment is detected.
    """
    parent = folder_for(runs, header.id)
    parent.mkdir(exist_ok=True)
    draft = Path(mkdtemp(prefix=".new-", dir=parent))
    try:
        draft.chmod(0o755)
        while True:
            run_id = free_run_id(header.id, runs)
            named = replace(header, id=run_id).to_json()
            line = log.protected_line({"time": 0.0, "kind": "run", "header": named})
            (draft / log.NAME).write_bytes(line + b"\n")
            write_info(draft, {**named, "status": RUNNING, "reason": None})
            try:
                return move_folder(draft, parent / run_id)
            except OSError:
                if not (parent / run_id).exists():
                    raise
    except BaseException:
        with suppress(OSError):
            shutil.rmtree(draft)
        raise


def _session_facts(header: RunHeader, session: _Session) -> dict[str, Any]:
    """Return the log entry for the start of a session."""
    facts = header.to_json()
    return {
        "session": session.number,
        "offset": session.offset,
        **{key: facts[key] for key in ("started", "operator", "backend", "clock", "seed", "versions")},
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _begin(folder: Path, header: RunHeader, session: _Session) -> RunWriter:
    """Lock the folder, open the two files and log the start of a session."""
    lock = lock_folder(folder)
    try:
        writer = RunWriter(folder, lock, header, session)
        writer.event(0.0, "session", **_session_facts(header, session))
        writer.flush()
        if session.number:
            write_info(folder, {**read_info(folder), "status": RUNNING, "reason": None})
    except OSError as problem:
        lock.release()
        raise RigctlError(
            f"cannot write to the run's folder: {problem.strerror}",
            where=Location(folder),
            exit_code=ExitCode.FAILED,
        ) from problem
    except BaseException:
        lock.release()
        raise
    return writer
