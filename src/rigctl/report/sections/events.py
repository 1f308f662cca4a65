"""What happened: alarms, faults, operators' answers, changes of state; not the many steps and commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.report.numbers import duration, number
from rigctl.report.run_data import Event, RunData
from rigctl.report.section import Section, cut, render
from rigctl.report.signals import ALARMS

#: kept in events.parquet, and too many to read
_LEFT_TO_THE_FILES = ("step", "command", "record", "measure", "session", "run", "end")


@dataclass(frozen=True)
class Row:
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
    """A table of events, alarms and faults marked."""
    shown_events = [
        (run, event) for run in runs for event in run.events if event.kind not in _LEFT_TO_THE_FILES
    ]
    omitted = sum(len(run.events) for run in runs) - len(shown_events)
    # when not all can be shown, what went wrong must not be among those left out
    shown_events, left_out = _most_important(shown_events)
    body = render(
        "events.html",
        rows=[_row(run, event) for run, event in shown_events],
        left_out=left_out,
        omitted=omitted,
        alarms=sum(event.kind in ALARMS for run in runs for event in run.events),
        several=len(runs) > 1,
    )
    return Section("events", "Events", body)


def _most_important(
    pairs: list[tuple[RunData, Event]],
) -> tuple[list[tuple[RunData, Event]], int]:
    ranked = sorted(range(len(pairs)), key=lambda place: pairs[place][1].kind not in ALARMS)
    kept, left_out = cut(ranked)
    return [pairs[place] for place in sorted(kept)], left_out


def _row(run: RunData, event: Event) -> Row:
    return Row(
        run=run.id,
        seconds=f"{number(event.time, 7)} s",
        after=duration(event.time),
        kind=event.kind,
        tone="bad" if event.kind in ALARMS else "plain",
        record=str(event.record) if event.record >= 0 else "",
        message=event.message or _facts(event),
        path=event.path or "",
    )


def _facts(event: Event) -> str:
    """What an event says of itself when it has no message."""
    hidden = ("record", "session")
    return ", ".join(
        f"{name.replace('_', ' ')} {number(value) if isinstance(value, float) else value}"
        for name, value in event.data.items()
        if name not in hidden and value is not None
    )
