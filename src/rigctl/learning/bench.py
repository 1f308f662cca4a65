"""Measurement of a round, on the bench that the rig file or the command line names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from rigctl.dataset import list_runs
from rigctl.errors import RigctlError
from rigctl.learning.learning_folder import STAMP
from rigctl.plan import Plan
from rigctl.planning import preview
from rigctl.procedure import expand, load_procedure
from rigctl.rig import load_rig
from rigctl.runner.launch import Launch, launch
from rigctl.runner.resume import Interrupted, open_interrupted, relaunch
from rigctl.runner.session import RunResult

#: statuses of runs that can be resumed
_GOES_ON = ("unclosed", "interrupted", "aborted")
#: wraps a launch with an operator who answers prompts and a live view, for the duration of the run
Attended = Callable[[Launch, Plan], AbstractContextManager[Launch]]


class LearningBench(Protocol):
    """Interface of learning to a bench: carry out a procedure, and forecast its duration."""

    def plan(self, procedure: Path, arguments: Mapping[str, str]) -> Plan:
        """The procedure on this bench's rig."""
        ...

    def measure(self, plan: Plan, number: int, since: str) -> RunResult:
        """Carry it out as round `number`; resume a run of it that was interrupted since `since`."""
        ...


def seconds_of(plan: Plan) -> float:
    """The expected duration of a plan, s of bench time."""
    return preview(plan).seconds


@dataclass(frozen=True)
class LaunchedBench:
    """The bench behind a backend, each round a run like any other: locked, supervised, safe in every ending.

    Parameters
    ----------
    how: makes the launch of a plan; on a simulated bench each round, from 1 on, has another seed.
    rig: a rig file to use instead of the one that procedures name.
    attended: provides the operator and the live view.
    """

    how: Callable[[Plan, int], Launch]
    rig: Path | None = None
    attended: Attended = field(default=lambda how, _: nullcontext(how))

    def plan(self, procedure: Path, arguments: Mapping[str, str]) -> Plan:
        """The procedure on this bench's rig."""
        read = load_procedure(procedure)
        return expand(read, load_rig(self.rig or read.rig_path), dict(arguments))

    def measure(self, plan: Plan, number: int, since: str) -> RunResult:
        """Carry it out as a new run, or resume an interrupted run of the same plan."""
        how = self.how(plan, number)
        before = cut_off(plan, how.runs, since)
        with self.attended(how, plan) as ready:
            return launch(plan, ready) if before is None else relaunch(before, ready)


def cut_off(plan: Plan, runs: Path, since: str) -> Interrupted | None:
    """The last run of a plan since `since` that was interrupted: by a kill, a power cut or Ctrl-C. A run that
    failed is not resumed, because its earlier records may be affected by the cause.

    Parameters
    ----------
    since: UTC date and time in the format of run ids; older runs belong to others.
    """
    for summary in reversed(list_runs(runs)):
        if summary.id[:STAMP] < since[:STAMP]:
            return None
        if summary.status in _GOES_ON and isinstance(summary.folder, Path):
            before = _same(summary.folder, plan)
            if before is not None:
                return before
    return None


def _same(folder: Path, plan: Plan) -> Interrupted | None:
    """A resumable run of this plan; None if its files have changed."""
    try:
        before = open_interrupted(folder)
    except RigctlError:
        return None
    return before if before.plan.digest == plan.digest else None
