"""From a plan to a run: bench opened, folder made, lock taken; everything given back, however it ends."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from rigctl.backends.protocol import Backend
from rigctl.backends.registry import create_backend
from rigctl.clock import Clock, ScaledClock, VirtualClock, real_clock
from rigctl.dataset import (
    RunHeader,
    RunWriter,
    Source,
    calibrations_of,
    current_versions,
    new_run_id,
    source_of_rig,
)
from rigctl.dataset.background import BackgroundWriter
from rigctl.errors import RigctlError
from rigctl.plan import Plan
from rigctl.planning.rates import refuse_rates
from rigctl.rig import Rig
from rigctl.runner.aside import beside
from rigctl.runner.drive import RESPONSE
from rigctl.runner.lock import RigLock
from rigctl.runner.operator import Operator
from rigctl.runner.requests import Control
from rigctl.runner.resume import Resume
from rigctl.runner.session import Observer, RunResult, run

#: backends that are no real bench and may run at any speed
UNREAL = ("simulated", "replay", "emulated")

#: options of a backend that a run is resumed with: what the bench was, and where it is, not what broke
REMEMBERED = ("port", "baud", "plant", "effects", "noise", "quantised", "seed")


@dataclass(frozen=True)
class Launch:
    """What a run needs besides its plan.

    Parameters
    ----------
    runs: the folder that holds the runs.
    operator: who answers.
    backend: name of the backend; the rig file's own when None.
    options: of the backend.
    clock: what the bench waits on.
    person: who is in charge, for ``run.json``.
    arguments: of the procedure, as they were given.
    seed: of everything random, on a simulated bench.
    controls: where requests come from.
    observer: who looks on.
    exclusive: whether nobody else may command this bench meanwhile; a private simulation needs no lock.
    dry: arm and read, move nothing.
    lock_folder: where locks lie; the user's state folder by default.
    response: s of wall time between two looks at requests.
    """

    runs: Path
    operator: Operator
    backend: str | None = None
    options: Mapping[str, object] = field(default_factory=dict)
    clock: Clock = field(default_factory=real_clock)
    person: str = ""
    arguments: Mapping[str, str] = field(default_factory=dict)
    seed: int | None = None
    controls: Sequence[Control] = ()
    observer: Observer | None = None
    exclusive: bool = True
    dry: bool = False
    lock_folder: Path | None = None
    response: float = RESPONSE


def clock_for(speed: str, backend: str) -> Clock:
    """The clock for ``max`` (virtual), ``1x`` (real) or ``10x``.

    Raises
    ------
    RigctlError
        the text is none of them, or a real bench is asked to be faster than time.
    """
    try:
        factor = math.inf if speed == "max" else float(speed.removesuffix("x"))
    except ValueError:
        factor = math.nan
    if not (0.001 <= factor <= 1e6 or factor == math.inf):
        raise RigctlError("not a speed", value=speed, expected="max, 1x, or e.g. 10x")
    if backend not in UNREAL and factor != 1.0:
        raise RigctlError("a real bench knows one speed", value=speed, expected="1x")
    if math.isinf(factor):
        return VirtualClock(started=datetime.now(UTC))
    return ScaledClock(speed=factor)


def bench_options(
    backend: str,
    rig: Rig,
    *,
    port: str | None = None,
    seed: int | None = None,
    recording: str | None = None,
    runs: Path | None = None,
    clear_trips: bool = False,
) -> dict[str, object]:
    """The options of a backend for what a command line can say.

    Raises
    ------
    RigctlError
        something is given that this backend has no use for.
    """
    given: dict[str, object] = {
        "port": port,
        "seed": seed,
        "run": recording,
        "clear_trips": clear_trips or None,
    }
    taken = {
        "simulated": ("seed",),
        "replay": ("run",),
        "serial": ("port", "clear_trips"),
        "emulated": ("seed", "clear_trips"),
    }
    known = taken.get(backend, tuple(given))
    for name, value in given.items():
        if value is not None and name not in known:
            what = "a run to play" if name == "run" else f"--{name.replace('_', '-')}"
            raise RigctlError(f"the {backend} backend takes no {what.removeprefix('a ')}", value=str(value))
    options = {name: given[name] for name in known if given.get(name) is not None}
    if backend == "serial":
        options = {"port": rig.backend.port, "baud": rig.backend.baud} | options
    if backend == "replay" and runs is not None:
        options["runs"] = str(runs)
    return {name: value for name, value in options.items() if value is not None}


def launch(plan: Plan, how: Launch) -> RunResult:
    """Carry out a plan as a new run.

    Raises
    ------
    RigctlError
        the bench cannot be reached or is in use, cannot be read as often as a record asks for, or the run's
        folder cannot be made; nothing has moved.
    """
    if (how.backend or plan.rig.backend.kind) in ("serial", "emulated"):
        refuse_rates(plan)
    with held(plan.rig, f"a run of '{plan.name}'", how) as lock, opened(plan.rig, how) as backend:
        writer = RunWriter.create(how.runs, header_of(plan, backend, how))
        return carry_out(plan, backend, writer, lock, how)


def carry_out(
    plan: Plan,
    backend: Backend,
    writer: RunWriter,
    lock: RigLock | None,
    how: Launch,
    resume_from: Resume | None = None,
) -> RunResult:
    """Run a plan on an open bench, with a writer that has its folder."""
    controls = list(how.controls)
    if lock is not None:
        lock.run = writer.folder
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


def header_of(plan: Plan, backend: Backend, how: Launch) -> RunHeader:
    """What is known of the run when it begins."""
    procedure = plan.procedure
    started = datetime.now(UTC)
    return RunHeader(
        id=new_run_id(plan.name, started, how.runs),
        procedure=Source(plan.name, procedure.text, procedure.sha256, _absolute(procedure.path)),
        rig=replace(source_of_rig(plan.rig), path=_absolute(plan.rig.path)),
        layout=plan.rig.layout,
        started=started,
        backend=backend.identity,
        operator=how.person,
        clock=backend.clock.name,
        seed=how.seed,
        versions=current_versions(),
        plan_digest=plan.digest,
        arguments={**plan.arguments, **how.arguments},
        calibrations=calibrations_of(plan.rig),
        options={name: _plain(how.options[name]) for name in REMEMBERED if name in how.options},
    )


def _plain(option: object) -> object:
    """An option as JSON has it."""
    return list(option) if isinstance(option, tuple) else option


def _absolute(path: Path | None) -> str:
    """As text, so that a run can go on from another folder."""
    return str(path.absolute()) if path is not None else ""


@contextmanager
def opened(rig: Rig, how: Launch) -> Iterator[Backend]:
    """The bench, open; closed again whatever happens before, in or after the run."""
    backend = create_backend(rig, how.backend, how.clock, how.options)
    try:
        backend.open()
        yield backend
    finally:
        backend.close()


@contextmanager
def held(rig: Rig, purpose: str, how: Launch) -> Iterator[RigLock | None]:
    """The rig's lock, where one is needed."""
    if not how.exclusive:
        yield None
        return
    with RigLock(rig.name, purpose, how.lock_folder) as lock:
        yield lock
