"""Events: alarms, faults, operators' answers, changes of state; not the many steps and commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.answers.numbers import duration, number, plural
from rigctl.dataset.history import EventEntry
from rigctl.report.run_data import RunData
from rigctl.report.section import Section, cut, render
from rigctl.report.signals import ALARMS

#: kinds that are stored in events.parquet but not listed, because they are too many
_LEFT_TO_THE_FILES = ("step", "command", "record", "measure", "session", "run", "end")


@dataclass(frozen=True)
class EventRow:
    """One event as it is shown."""

    run: str
    seconds: str
    after: str
    kind: str
    tone: str
    record: str
    message: str
    path: str


def build(runs: Sequence[RunData]) -> Section:
    """Alarms and faults first, then everything else in order."""
    every = [(run, event) for run in runs for event in run.events]
    alarms, alarms_left = cut([pair for pair in every if pair[1].kind in ALARMS])
    others, _ = cut([pair for pair in every if pair[1].kind not in (*ALARMS, *_LEFT_TO_THE_FILES)])
    body = render(
        "events.html",
        tables=[[_row(run, event) for run, event in part] for part in (alarms, others) if part],
        alarms=len(alarms) + alarms_left,
        left_out=len(every) - len(alarms) - len(others),
        several=len(runs) > 1,
    )
    count = len(alarms) + alarms_left
    hint = f"{plural(count, 'alarm or fault', 'alarms and faults')}" if count else "no alarms, no faults"
    return Section("events", "Events", body, folded=not count, hint=hint)


def _row(run: RunData, event: EventEntry) -> EventRow:
    return EventRow(
        run=run.id,
        seconds=f"{number(event.time, 7)} s",
        after=duration(event.time),
        kind=event.kind,
        tone="bad" if event.kind in ALARMS else "plain",
        record=str(event.record) if event.record >= 0 else "",
        message=event.message or _facts(event),
        path=event.path or "",
    )


def _facts(event: EventEntry) -> str:
    """The text of an event that has no message."""
    hidden = ("record", "session")
    return ", ".join(
        f"{name.replace('_', ' ')} {number(value) if isinstance(value, float) else value}"
        for name, value in event.data.items()
        if name not in hidden and value is not None
    )
