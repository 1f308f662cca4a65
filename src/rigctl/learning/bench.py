"""How a round is measured: on whatever bench the rig file or the command line names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from rigctl.dataset import list_runs
from rigctl.errors import RigctlError
from rigctl.plan import Plan
from rigctl.planning import preview
from rigctl.procedure import expand, load_procedure
from rigctl.rig import load_rig
from rigctl.runner.launch import Launch, launch
from rigctl.runner.relaunch import Interrupted, open_interrupted, relaunch
from rigctl.runner.session import RunResult

#: characters of a run's id that say when it began
_STAMP = 15
#: how runs ended that are gone on with
_GOES_ON = ("unclosed", "interrupted", "aborted")
#: makes of a launch one with somebody who answers and looks on, for as long as the run takes
Attended = Callable[[Launch, Plan], AbstractContextManager[Launch]]


class Bench(Protocol):
    """What learning needs of a bench: to carry out a procedure, and to say how long that takes."""

    def plan(self, procedure: Path, arguments: Mapping[str, str]) -> Plan:
        """The procedure on this bench's rig."""
        ...

    def measure(self, plan: Plan, number: int, since: str) -> RunResult:
        """Carry it out as round `number`; go on with a run of it that was cut off since then."""
        ...


def seconds_of(plan: Plan) -> float:
    """What a plan is expected to take, s of the rig's time."""
    return preview(plan).seconds


@dataclass(frozen=True)
class LaunchedBench:
    """The bench behind a backend, each round a run like any other: locked, guarded, safe in every ending.

    Parameters
    ----------
    how: makes the launch of a plan; each round, from 1 on, has another seed on a simulated bench.
    rig: another rig file than procedures name.
    attended: who answers and looks on.
    """

    how: Callable[[Plan, int], Launch]
    rig: Path | None = None
    attended: Attended = field(default=lambda how, _: nullcontext(how))

    def plan(self, procedure: Path, arguments: Mapping[str, str]) -> Plan:
        """The procedure on this bench's rig."""
        read = load_procedure(procedure)
        return expand(read, load_rig(self.rig or read.rig_path), dict(arguments))

    def measure(self, plan: Plan, number: int, since: str) -> RunResult:
        """Carry it out as a new run, or go on with one of the same plan that was cut off."""
        how = self.how(plan, number)
        before = cut_off(plan, how.runs, since)
        with self.attended(how, plan) as ready:
            return launch(plan, ready) if before is None else relaunch(before, ready)


def cut_off(plan: Plan, runs: Path, since: str) -> Interrupted | None:
    """The last run of a plan since then, where its program left it behind, or somebody ended it: a kill, a
    power cut, Ctrl-C. One that failed is not gone on with: what it failed of may have spoilt it before.

    Parameters
    ----------
    since: UTC date and time as run ids begin with it; what is older belongs to somebody else.
    """
    for summary in reversed(list_runs(runs)):
        if summary.id[:_STAMP] < since[:_STAMP]:
            return None
        if summary.status in _GOES_ON and isinstance(summary.folder, Path):
            before = _same(summary.folder, plan)
            if before is not None:
                return before
    return None


def _same(folder: Path, plan: Plan) -> Interrupted | None:
    """A run that can go on, of this plan; None where its files are others now."""
    try:
        before = open_interrupted(folder)
    except RigctlError:
        return None
    return before if before.plan.digest == plan.digest else None
