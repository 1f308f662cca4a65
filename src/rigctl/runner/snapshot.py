"""The state of a run, for people and programs that observe it: a cheap snapshot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigctl.runner.interlocks import Alarm


@dataclass(frozen=True, slots=True)
class ShownEvent:
    """A logged event that is worth showing."""

    time: float
    kind: str
    message: str


@dataclass(frozen=True, slots=True)
class View:
    """A snapshot of a run in progress; values SI, times s of bench time.

    Parameters
    ----------
    run: the run's id.
    state: of the run, e.g. ``running``.
    time: now.
    path, label: of the step in progress.
    record: index of the open record, −1 between records.
    records_done, records_total: how many records are complete, and how many the plan has.
    progress: share of the expected duration that is done, 0 to 1.
    time_left: expected, s; None when it is unknown.
    values: the newest reading of every channel by name.
    commands: the command of every actuator by name.
    alarms: every alarm that is latched.
    happenings: the newest events, oldest first.
    question: the open question to the operator, or None.
    asked: the question alone, without the text typed so far.
    remote: whether it can be answered remotely, see `rigctl.runner.operators.remote_operator`.
    message: why the run ended, or what it is waiting for.
    unconfirmed: outputs that may still be on although they were to be made safe, or None.
    """

    run: str
    state: str
    time: float
    path: str = ""
    label: str = ""
    record: int = -1
    records_done: int = 0
    records_total: int = 0
    progress: float = 0.0
    time_left: float | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    commands: Mapping[str, float] = field(default_factory=dict)
    alarms: tuple[Alarm, ...] = ()
    happenings: tuple[ShownEvent, ...] = ()
    question: str | None = None
    asked: str | None = None
    remote: bool = False
    message: str = ""
    unconfirmed: str | None = None
