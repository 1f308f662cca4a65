"""From a plan to a run: opens the bench, makes the folder, takes the lock; releases everything at the end.

In: a plan and a `Launch`. Out: the result of the run, whose data are in a new folder. Whatever can be refused
is refused before the bench is opened, and the bench is opened before the folder is made: a run that could not
begin leaves nothing behind.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from pathlib import Path

from rigctl.backends.protocol import Backend
from rigctl.dataset import (
    RunHeader,
    RunWriter,
    Source,
    calibrations_of,
    current_versions,
    new_run_id,
    source_of_rig,
)
from rigctl.dataset.recording.disk_thread import BackgroundWriter
from rigctl.dataset.storage.sending import upload_if_wanted
from rigctl.errors import RigctlError, require_known
from rigctl.plan import Plan
from rigctl.plan.identity import NAMES, settled
from rigctl.planning.lost_devices import refuse_needed
from rigctl.planning.rates import refuse_rates
from rigctl.runner.bench_access import Access, held, opened
from rigctl.runner.operators.control_thread import beside
from rigctl.runner.operators.operator import Operator
from rigctl.runner.operators.requests import RESPONSE, Control
from rigctl.runner.remaining_plan import Resume
from rigctl.runner.rig_lock import BenchLock
from rigctl.runner.session import Observer, RunResult, run

#: backend options with which a run is resumed: which bench, and where it is, but not the simulated faults
REMEMBERED = ("port", "baud", "plant", "effects", "noise", "quantised", "seed")


@dataclass(frozen=True, kw_only=True)
class Launch(Access):
    """Settings of a run besides its plan and the access to its bench.

    Parameters
    ----------
    operator: who answers.
    person: who is in charge, for ``run.json``.
    device: what is known of the device under test, by name.
    arguments: of the procedure, as given.
    seed: of everything random, on a simulated bench.
    controls: sources of requests.
    observer: is shown the state of the run.
    dry: arm and read, move nothing.
    response: s of wall time between two checks for requests.
    """

    operator: Operator
    person: str = ""
    device: Mapping[str, str] = field(default_factory=dict)
    arguments: Mapping[str, str] = field(default_factory=dict)
    seed: int | None = None
    controls: Sequence[Control] = ()
    observer: Observer | None = None
    dry: bool = False
    response: float = RESPONSE


def operated(access: Access, operator: Operator, control: Control) -> Launch:
    """The settings for moving a bench by hand; the person may end it."""
    settings = {each.name: getattr(access, each.name) for each in fields(access)}
    return Launch(**settings, operator=operator, controls=(control,))


def launch(plan: Plan, how: Launch) -> RunResult:
    """Carry out a plan as a new run.

    Raises
    ------
    RigctlError
        something that the procedure requires was not given, the bench cannot be reached or is in use, cannot
        be read as fast as a record requires, or the run's folder cannot be made; nothing has moved.
    """
    # What needs no bench is checked first; then the lock, as a bench in use must not be opened.
    _require_identity(plan, how)
    refuse_rates(plan, how.backend, how.options)
    refuse_needed(plan)
    with held(plan.rig, f"a run of '{plan.name}'", how) as lock, opened(plan.rig, how) as backend:
        writer = RunWriter.create(how.runs, header_of(plan, backend, how))
        result = carry_out(plan, backend, writer, lock, how)
    return stored(result)


def stored(result: RunResult) -> RunResult:
    """Send a run that has ended to the project's storage, if it has one; the bench is already free."""
    if result.folder is not None:
        upload_if_wanted(result.folder)
    return result


def carry_out(
    plan: Plan,
    backend: Backend,
    writer: RunWriter,
    lock: BenchLock | None,
    how: Launch,
    resume_from: Resume | None = None,
) -> RunResult:
    """Run a plan on an open bench, with a writer for its folder."""
    controls = list(how.controls)
    if lock is not None:
        # Now that there is a folder, other programs can find the run by the lock, and ask it to end.
        lock.take_for(writer.folder)
        controls.append(beside(lock, backend.clock))
    real = math.isfinite(backend.clock.speed)  # nobody waits for a disk in virtual time
    return run(
        plan,
        backend,
        BackgroundWriter(writer) if real else writer,
        operator=how.operator,
        controls=controls,
        observer=how.observer,
        dry=how.dry,
        resume_from=resume_from,
        response=how.response,
    )


def _require_identity(plan: Plan, how: Launch) -> None:
    """Refuse to start on a bench without the facts that the procedure requires about device and person."""
    _, missing = settled(plan.procedure.identity, _identity(how))
    if missing and (how.backend or plan.rig.kind) not in ("simulated", "replay"):
        named = " and the ".join(name.replace("_", " ") for name in missing)
        raise RigctlError(f"the procedure requires the {named}", where=plan.root.where)


def _identity(how: Launch) -> dict[str, str | None]:
    """The given identity of device, part and operator."""
    require_known("fact of the device under test", how.device, NAMES)
    return {**how.device, "operator": how.person or None}


def header_of(plan: Plan, backend: Backend, how: Launch) -> RunHeader:
    """Header of the run."""
    procedure = plan.procedure
    started = datetime.now(UTC)
    known, _ = settled(procedure.identity, _identity(how))
    return RunHeader(
        id=new_run_id(plan.name, started, how.runs),
        procedure=Source(plan.name, procedure.text, procedure.sha256, _absolute(procedure.path)),
        rig=replace(source_of_rig(plan.rig), path=_absolute(plan.rig.path)),
        layout=plan.rig.layout,
        started=started,
        backend=backend.identity,
        operator=how.person or known.operator,
        device=known.device,
        clock=backend.clock.name,
        seed=how.seed,
        versions=current_versions(),
        plan_digest=plan.digest,
        arguments={**plan.arguments, **how.arguments},
        calibrations=calibrations_of(plan.rig),
        options={name: _plain(how.options[name]) for name in REMEMBERED if name in how.options},
    )


def _plain(option: object) -> object:
    """An option in a form for JSON."""
    if isinstance(option, Mapping):
        return dict(option)
    return list(option) if isinstance(option, tuple) else option


def _absolute(path: Path | None) -> str:
    """The absolute path as text, so that a run can be resumed from another folder."""
    return str(path.absolute()) if path is not None else ""
