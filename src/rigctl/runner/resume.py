"""Resuming an interrupted run: what must not have changed, and what is already done.

In: the folder of a run that ended early. Out: a new session in the same folder, which measures the
records that are missing. All records of a run must come from one procedure, one rig file and one bench,
so that each of these is compared with what the run began with; only then is anything opened.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl.dataset import RunHeader, RunWriter
from rigctl.dataset.history import COMPLETE, History
from rigctl.dataset.pass_fail import judge
from rigctl.dataset.recording.finalise import recovered_history
from rigctl.dataset.recording.writer_lock import in_progress
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.plan import Plan
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig, load_rig
from rigctl.runner.bench_access import held, opened
from rigctl.runner.launch import Launch, carry_out, header_of, stored
from rigctl.runner.remaining_plan import Resume, record_paths
from rigctl.runner.session import RunResult

#: properties of a bench that must not change within a run; faults and seed may
_SAME = ("kind", "plant", "noise")


@dataclass(frozen=True)
class Interrupted:
    """A run that can be resumed: its original plan, and how far it got."""

    folder: Path
    plan: Plan
    history: History
    done: Resume

    @property
    def left(self) -> int:
        """The number of incomplete records."""
        return sum(path not in self.done.completed for path in record_paths(self.plan.root))


def open_interrupted(folder: Path) -> Interrupted:
    """Read a run that ended early and check that it can be resumed unchanged.

    Raises
    ------
    RigctlError
        it is finished or in progress; its procedure or rig file has changed since; its log is damaged.
    """
    # First, as `recovered_history` may rewrite the files, which belong to a run that is still going on.
    if in_progress(folder):
        raise RigctlError("the run is in progress", value=folder.name, exit_code=ExitCode.FAILED)
    # After a kill there is only the journal and the log; this makes the tables of them, and tells what is
    # complete.
    history = recovered_history(folder)
    if history.header.source != "bench":
        raise RigctlError("the run was imported, not carried out", value=folder.name)
    if history.status == "finished":
        raise RigctlError("the run is finished; there is nothing to resume", value=folder.name)
    return Interrupted(folder, plan_of(history.header), history, _done(history))


def plan_of(header: RunHeader) -> Plan:
    """The plan with which a run was started, from its files.

    Raises
    ------
    RigctlError
        they have changed since.
    """
    return _same_plan(header, _same_rig(header))


def relaunch(run_before: Interrupted, how: Launch) -> RunResult:
    """Resume at the first incomplete record, in the same folder.

    Raises
    ------
    RigctlError
        as `rigctl.runner.launch.launch`; or the bench is not the same as before.
    """
    plan = run_before.plan
    with held(plan.rig, f"a run of '{plan.name}'", how) as lock, opened(plan.rig, how) as backend:
        # The same run with a new session: times, versions and calibrations are those of today, the id is the
        # old one.
        header = replace(header_of(plan, backend, how), id=run_before.history.header.id)
        _require_same_bench(run_before.history.header.backend, header.backend)
        writer = RunWriter.reopen(run_before.folder, header)
        result = carry_out(plan, backend, writer, lock, how, run_before.done)
    return stored(result)


def _require_same_bench(before: Mapping[str, str], now: Mapping[str, str]) -> None:
    """Refuse a simulated bench with other equations: all records of a run must come from the same system."""
    for key in _SAME:
        if before.get(key) != now.get(key):
            raise RigctlError(
                "this is another bench than the run began on",
                value=f"{key}: {now.get(key, 'none')}",
                expected=before.get(key, "none"),
                hint="Begin a new run; a simulated bench is resumed as the rig file describes it",
            )


def _same_rig(header: RunHeader) -> Rig:
    recorded = header.rig
    path = Path(recorded.path)
    rig = load_rig(path)
    # By checksum of the whole file: which change is harmless cannot be told, and a mixed run would be
    # worthless.
    if rig.sha256 != recorded.sha256:
        raise _changed("rig", path)
    return rig


def _same_plan(header: RunHeader, rig: Rig) -> Plan:
    recorded = header.procedure
    path = Path(recorded.path)
    procedure = load_procedure(path)
    if procedure.sha256 != recorded.sha256:
        raise _changed("procedure", path)
    plan = expand(procedure, rig, dict(header.arguments))
    # The file may be unchanged while a procedure that it calls, or what rigctl makes of it, is not.
    if plan.digest != header.plan_digest:
        raise _changed("a procedure that it calls, or rigctl itself,", path)
    return plan


def _changed(what: str, path: Path) -> RigctlError:
    return RigctlError(
        f"{what} has changed since the run began",
        where=Location(path),
        hint="Undo the change ('rigctl runs show' has the text that was used), or begin a new run",
    )


def _done(history: History) -> Resume:
    # A damaged or interrupted record is measured again, though its samples are kept.
    completed = frozenset(record.path for record in history.records if record.outcome == COMPLETE)
    measures = dict(history.measures)
    for record in history.records:
        measures |= record.measures
    values = {
        name: (measured.value, measured.unit, measured.difference) for name, measured in measures.items()
    }
    # What a record that is measured again has missed is not held against the device.
    done = [
        measure
        for measure in judge(history).missed
        if measure.record is None or history.records[measure.taken.record].outcome == COMPLETE
    ]
    return Resume(completed, values, tuple(measure.sentence() for measure in done))
