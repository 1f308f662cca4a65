"""The content of a run's log: its sessions, records and measures, and how it ended. Reads only.

In: the lines of ``log.jsonl``, some of which may be damaged. Out: a `History`. The log is read from its
first to its last line, with the open record and the offset of the session as the only state. A line that
is damaged costs what it said and no more, except where a record was open: what it said might have been a
command in that record, which is then marked as damaged. Times in the log are those of a session; here
they are those of the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from rigctl.dataset import run_json
from rigctl.dataset.recording import log
from rigctl.dataset.recording.header import RunHeader
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.plan.measured import MeasuredValue

#: status of a run, and outcome of a record, that was not ended: killed, or the computer stopped
INTERRUPTED: Final = "interrupted"
#: outcome of a record that was measured as planned
COMPLETE: Final = "complete"
#: outcome of a record that lost samples or log entries through damaged files
DAMAGED: Final = "damaged"
_KILLED: Final = "the program that carried it out ended without closing the run"


@dataclass
class RecordEntry:
    """One record according to the log; times in s of the run, `end` None if it is not in the log.

    `rows` is its number of samples and `missing` the largest share that it lacks, of its samples or of the
    readings of a channel; None if they are not in the log.
    """

    index: int
    name: str
    path: str
    rate: float
    sweep: Mapping[str, tuple[float, str]]
    session: int
    start: float
    end: float | None = None
    outcome: str = INTERRUPTED
    rows: int | None = None
    missing: float | None = None
    measures: dict[str, MeasuredValue] = field(default_factory=dict)


@dataclass(frozen=True)
class EventEntry:
    """One line of the log, its time in s of the run; `data` has the fields without a column."""

    time: float
    kind: str
    record: int
    path: str | None
    message: str | None
    data: Mapping[str, Any]


@dataclass(frozen=True)
class TakenMeasure:
    """A measured value and its time, in s of the run; `record` is the open record, −1 for none."""

    time: float
    record: int
    value: MeasuredValue


@dataclass
class Session:
    """One session of a run, carried out by one process; `offset` is the run's time at its start."""

    number: int
    offset: float
    facts: Mapping[str, Any]
    ended: float | None = None
    status: str = INTERRUPTED
    reason: str | None = _KILLED
    unconfirmed: str | None = None  #: outputs that may still be on


@dataclass
class Absence:
    """A time in which a run waited for a lost device (`lost` is ``pause``), or did without it (``continue``).

    `begin` is when that was noticed, `end` when the device was back, s of the run; None if it stayed away.
    """

    device: str
    lost: str
    begin: float
    end: float | None = None


@dataclass
class History:
    """The parsed log of a run."""

    header: RunHeader
    sessions: list[Session] = field(default_factory=list)
    records: list[RecordEntry] = field(default_factory=list)
    measures: dict[str, MeasuredValue] = field(default_factory=dict)  #: outside any record
    taken: list[TakenMeasure] = field(default_factory=list)  #: every one, in the order of time
    events: list[EventEntry] = field(default_factory=list)
    absences: list[Absence] = field(default_factory=list)
    last_time: float = 0.0
    damaged_lines: tuple[int, ...] = ()  #: line numbers in the log, from 1; their content is lost

    @property
    def status(self) -> str:
        """End status of the last session: ``finished``, ``failed``, ``aborted`` or ``interrupted``."""
        return self.sessions[-1].status if self.sessions else INTERRUPTED

    @property
    def reason(self) -> str | None:
        """The reason why it did not finish."""
        return self.sessions[-1].reason if self.sessions else _KILLED

    @property
    def unconfirmed(self) -> str | None:
        """The outputs that may still have been on when the last session ended."""
        return self.sessions[-1].unconfirmed if self.sessions else None


def absences_in(info: Mapping[str, Any]) -> str:
    """The absences of a run's ``run.json`` in words: ``meter: gone from 12.3 s on (the run went on)``."""
    ways = {"pause": "the run waited", "continue": "the run went on"}
    return "; ".join(
        f"{one['device']}: gone from {one['begin']:.1f} s "
        f"{'on' if one['end'] is None else 'to {:.1f} s'.format(one['end'])} ({ways.get(one['lost'], '')})"
        for one in info.get("absences") or ()
    )


def read_history(folder: Path) -> History:
    """Read the log of a run.

    A damaged line is skipped and counted; a record that was open at that line is `DAMAGED`.

    Raises
    ------
    RigctlError
        there is no log, its first line is damaged, or the remaining lines are inconsistent.
    """
    path = folder / log.NAME
    lines = log.read_lines(path)
    try:
        history = _interpret(lines)
    except (KeyError, TypeError, ValueError, IndexError) as problem:
        damaged = next((number for number, line in enumerate(lines, start=1) if line is None), None)
        raise RigctlError(
            "the log is damaged",
            value=None if damaged else str(problem),
            where=Location(path, damaged),
            exit_code=ExitCode.FAILED,
        ) from problem
    run_json.require_own(folder, history.header.id, path)
    return history


def _interpret(lines: Sequence[Mapping[str, Any] | None]) -> History:
    first = lines[0] if lines else None
    if first is None:
        raise ValueError("its first line is damaged or missing")
    history = History(RunHeader.from_json(first["header"]))
    history.damaged_lines = tuple(number for number, line in enumerate(lines, start=1) if line is None)
    reader = _Reader(history)
    for line in lines[1:]:
        if line is None:
            reader.skip()
        else:
            reader.read(line)
    return history


class _Reader:
    """Reads the lines and keeps track of the open record."""

    def __init__(self, history: History) -> None:
        self._history = history
        self._open: RecordEntry | None = None
        self._offset = 0.0

    def skip(self) -> None:
        """Skip a damaged line: its content about the open record is lost."""
        if self._open is not None:
            self._open.outcome = DAMAGED

    def read(self, line: Mapping[str, Any]) -> None:
        kind = line["kind"]
        # A new session ends whatever the last one had left open: its program was killed.
        if kind == "session":
            self._offset = line["offset"]
            self._open = None
            facts = {key: line[key] for key in line if key not in ("time", "kind", "session", "offset")}
            self._history.sessions.append(Session(line["session"], self._offset, facts))
        elif not self._history.sessions:  # its line is damaged; the first session begins with the run
            self._history.sessions.append(
                Session(0, 0.0, {"started": self._history.header.started.isoformat()})
            )
        time = line["time"] + self._offset
        self._history.last_time = max(self._history.last_time, time)
        # Opened before, and closed after its line becomes an event, so that both belong to the record.
        if kind == "record" and line["state"] == "open":
            self._open_record(line, time)
        self._add_event(line, time)
        if kind == "record" and line["state"] == "closed":
            self._close_record(line, time)
        elif kind == "measure":
            self._add_unlogged(line["record"] + 1, time)
            self._add_measure(line, time)
        elif "lost" in line and kind == "gap":
            self._history.absences.append(Absence(line["device"], line["lost"], time))
        elif "back" in line and kind == "note":
            self._end_absence(line["back"], time)
        elif kind == "end":
            session = self._history.sessions[-1]
            session.ended, session.status, session.reason = time, line["status"], line["reason"]
            session.unconfirmed = line.get("unconfirmed")

    def _end_absence(self, device: str, time: float) -> None:
        for absence in self._history.absences:
            if absence.device == device and absence.end is None:
                absence.end = time

    def _open_record(self, line: Mapping[str, Any], time: float) -> None:
        sweep = {name: (_number(value), unit) for name, (value, unit) in line["sweep"].items()}
        session, index = self._history.sessions[-1].number, line["record"]
        self._add_unlogged(index, time)
        if index != len(self._history.records):
            raise ValueError(f"record {index} where {len(self._history.records)} was due")
        self._open = RecordEntry(index, line["name"], line["path"], line["rate"], sweep, session, start=time)
        self._history.records.append(self._open)

    def _add_unlogged(self, before: int, time: float) -> None:
        """Add the records whose opening line was damaged, so that their samples have a record."""
        records, session = self._history.records, self._history.sessions[-1].number
        while self._history.damaged_lines and len(records) < before:
            unlogged = RecordEntry(len(records), "", "", 0.0, {}, session, start=time, outcome=DAMAGED)
            records.append(unlogged)

    def _close_record(self, line: Mapping[str, Any], time: float) -> None:
        self._add_unlogged(line["record"] + 1, time)
        if self._open is not None and self._open.index == line["record"]:
            self._open.end, self._open.rows = time, line.get("rows")
            self._open.missing = line.get("missing")
            if self._open.outcome != DAMAGED:
                self._open.outcome = line["outcome"]
        self._open = None

    def _add_measure(self, line: Mapping[str, Any], time: float) -> None:
        index = line["record"]
        target = self._history.records[index].measures if index >= 0 else self._history.measures
        facts = {key: line[key] for key in ("name", "unit", "low", "high", "passed", "difference")}
        later = {"typed": line.get("typed", False), "path": line.get("path") or ""}  # not in older logs
        missing = float(line.get("missing", 0.0))
        value = MeasuredValue(value=_number(line["value"]), **facts, **later, missing=missing)
        target[line["name"]] = value
        self._history.taken.append(TakenMeasure(time, index, value))

    def _add_event(self, line: Mapping[str, Any], time: float) -> None:
        known = ("time", "kind", "message", "path")
        data = {key: value for key, value in line.items() if key not in known}
        record = self._open.index if self._open else -1
        path, message = line.get("path"), line.get("message")
        self._history.events.append(EventEntry(time, line["kind"], record, _text(path), _text(message), data))


def _number(value: float | None) -> float:
    """Return a number; JSON has no NaN, which was written as null."""
    return float("nan") if value is None else float(value)


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def ended_at(history: History, seconds: float) -> datetime:
    """Return the calendar time at `seconds` of the run's time, by the clock of its last session."""
    from datetime import timedelta

    if not history.sessions:
        return history.header.started + timedelta(seconds=seconds)
    last = history.sessions[-1]
    return datetime.fromisoformat(last.facts["started"]) + timedelta(seconds=seconds - last.offset)
