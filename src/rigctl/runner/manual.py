"""The bench by hand: everything off, one actuator moved, the channels watched. Nothing is recorded."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from rigctl.backends.errors import BackendLost, BenchTripped
from rigctl.backends.protocol import Backend, Sample
from rigctl.dataset.catalogue import run_folders
from rigctl.dataset.lock import read_state
from rigctl.dataset.run_json import read_info
from rigctl.errors import ExitCode, Location, RigctlError, unknown_name
from rigctl.plan import Plan
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import Rig
from rigctl.runner.aside import beside
from rigctl.runner.control import send
from rigctl.runner.interlocks import Alarm, Interlocks
from rigctl.runner.launch import UNREAL, Launch, held, opened
from rigctl.runner.lock import RigLock
from rigctl.runner.recorder import Unrecorded
from rigctl.runner.requests import Request
from rigctl.runner.session import RunResult, run
from rigctl.runner.signals import Signals

#: s of wall time that Ctrl-C may have to wait
_RESPONSE = 0.1

#: s of wall time that a run may take to answer, and again to say that its outputs are safe
_ANSWER = 0.8
_LOOK = 0.02
_ENDED = ("finished", "failed", "aborted")

#: line and column at the start of a reason
_PLACE = re.compile(r"^\d+:\d+: ")

OnEvent = Callable[[float, str, Mapping[str, Any]], None]


@dataclass(frozen=True)
class Reading:
    """One sample of a bench that is only watched, and the alarms that it raised or cleared."""

    sample: Sample
    alarms: Sequence[Alarm]


@dataclass(frozen=True)
class SwitchedOff:
    """What `switch_off` did.

    Parameters
    ----------
    done: one sentence.
    confirmed: whether every output was read back, or the bench has answered its command, or the run that has
        the bench says so.
    known_by: how that is known.
    ended: the runs that were ended, each with its answer.
    """

    done: str
    confirmed: bool
    known_by: str
    ended: tuple[str, ...] = ()


def switch_off(rig: Rig, how: Launch) -> SwitchedOff:
    """Bring every output to the safe state, now, and read them back.

    Runs in progress on this bench, simulated ones too, are asked to end: their own first act is the same.
    Whoever else has the bench, or does not answer, loses it.

    Raises
    ------
    RigctlError
        the bench cannot be reached, or its outputs are others than commanded.
    """
    owner = RigLock(rig.name, "", how.lock_folder).owner() if how.exclusive else None
    folders = [Path(owner.run)] if owner is not None and owner.run else []
    holder = folders[0] if folders else None
    folders += [folder for folder in _in_progress(rig, how.runs) if folder not in folders]
    ended, safe_by_run = [], False
    for folder in folders:
        try:
            answer = send(folder, Request.ABORT, timeout=_ANSWER)
        except RigctlError as error:
            answer = error.what
        else:
            safe_by_run = safe_by_run or (folder == holder and _made_safe(folder))
        ended.append(f"{folder.name}: {answer}")
    if safe_by_run:
        return SwitchedOff(
            "; ".join(ended), True, "the run that has the bench has made it safe", tuple(ended)
        )
    done, confirmed, known_by = _switch_off_here(rig, how)
    return SwitchedOff("; ".join([*ended, done]), confirmed, known_by, tuple(ended))


def _in_progress(rig: Rig, runs: Path) -> list[Path]:
    """Runs on a bench of this name that are carried out now, from this project."""
    found = []
    for folder in reversed(run_folders(runs)):
        state = read_state(folder)
        if state is None or not state.fresh or state.fields.get("state") in _ENDED:
            continue
        with suppress(RigctlError):
            kept = read_info(folder).get("rig")
            if isinstance(kept, dict) and kept.get("name") == rig.name:
                found.append(folder)
    return found


def _made_safe(folder: Path) -> bool:
    """Whether a run that was asked to end says, soon, that its outputs are confirmed to be safe."""
    give_up = monotonic() + _ANSWER
    while monotonic() < give_up:
        state = read_state(folder)
        fields = state.fields if state is not None else {}
        if fields.get("state") in ("finishing", *_ENDED):
            return fields.get("unconfirmed", "") is None
        sleep(_LOOK)
    return False


def _switch_off_here(rig: Rig, how: Launch) -> tuple[str, bool, str]:
    """What was done, whether it is confirmed, and how that is known."""
    told = ""
    confirmed, known_by = True, "the bench has answered each command"
    with RigLock(rig.name, "'rigctl off'", how.lock_folder, at_any_cost=True):
        try:
            with opened(rig, how) as backend:
                backend.safe()
                read = _read_back(rig, backend)
                confirmed, known_by = _known_by(rig, read, backend.outputs_answered)
                told = "".join(f"; {notice.message}" for notice in backend.take_notices())
        except BenchTripped as tripped:
            told = f"; {tripped.what}; '--clear-trips' clears it once its cause is gone"
        except BackendLost as lost:
            raise BackendLost(
                lost.what,
                value=lost.value,
                hint="Switch the bench off by hand, at its supply; then look at the cable",
            ) from None
    if (how.backend or rig.backend.kind) in UNREAL:
        confirmed = True
        known_by = f"a {how.backend or rig.backend.kind} bench of its own: no real one was touched"
    states = ", ".join(
        f"{name} {rig.actuators[name].show(float(value))}" for name, value in rig.safe_state.items()
    )
    outputs = "outputs are safe" if confirmed else "OUTPUTS NOT CONFIRMED SAFE, commanded"
    return f"{outputs}: {states}{told} ({known_by})", confirmed, known_by


def _known_by(rig: Rig, read: frozenset[str], answered: frozenset[str]) -> tuple[bool, str]:
    """Whether every driven output is confirmed to be safe, and by what."""
    outputs = [name for name in rig.safe_state if rig.actuators[name].by == "driven"]
    unsure = [name for name in outputs if name not in read | answered]
    if unsure:
        return False, f"sent, not confirmed: {', '.join(unsure)}; see for yourself whether it is off"
    unread = [name for name in outputs if name not in read]
    if not unread:
        return True, "read back from the bench"
    if len(unread) == len(outputs):
        return True, "the bench has answered each command"
    return True, f"read back from the bench; {', '.join(unread)}: the bench has answered the command"


def _read_back(rig: Rig, backend: Backend) -> frozenset[str]:
    """Read the outputs as they are now: those that the bench reports; none where no sample came.

    Raises
    ------
    RigctlError
        one is other than its safe value.
    """
    backend.start(rig.monitor_rate)
    sample = backend.next_sample(min(1.0, 2.0 / rig.monitor_rate))
    if sample is None:
        return frozenset()
    for name, value in zip(rig.layout.commands, sample.commands, strict=True):
        safe = rig.safe_state.get(name)
        if safe is not None and rig.actuators[name].by == "driven" and value != float(safe):
            raise RigctlError(
                f"{name} is {rig.actuators[name].show(value)}, though it was commanded to be safe",
                hint="Switch the bench off by hand, at its supply",
                exit_code=ExitCode.FAILED,
            )
    return backend.outputs_read


def jog(
    rig: Rig, actuator: str, value: str, duration: str | None, how: Launch, on_event: OnEvent
) -> RunResult:
    """Command one actuator, for a time or until the operator ends it; every output is safe afterwards.

    Interlocks count as in a run: a limit that is exceeded already refuses, one that trips ends it.

    Raises
    ------
    RigctlError
        no such actuator, a value that it cannot take, or the bench cannot be reached.
    """
    plan = _plan_of_jog(rig, actuator, value, duration)
    with held(rig, f"'rigctl jog {actuator}'", how) as lock, opened(rig, how) as backend:
        controls = [*how.controls, *([beside(lock, backend.clock)] if lock is not None else [])]
        result = run(
            plan,
            backend,
            Unrecorded(on_event),
            operator=how.operator,
            controls=controls,
            observer=how.observer,
        )
    # a place in the procedure that was made up here helps nobody
    return replace(result, reason=_PLACE.sub("", result.reason)) if result.reason else result


def needs_person(rig: Rig, actuator: str, duration: str | None, how: Launch) -> bool:
    """Whether somebody has to answer during a jog: to end it, or because the actuator is turned by hand.

    The operator of a bench that is no real one is simulated along with it.
    """
    known = rig.actuators.get(actuator)
    if known is None:
        return False
    if known.by == "operator":
        return (how.backend or rig.backend.kind) not in UNREAL
    return duration is None


def watch(rig: Rig, how: Launch, rate: float) -> Generator[Reading, None, None]:
    """Samples of a bench at rest, until the caller has enough or somebody interrupts.

    Raises
    ------
    RigctlError
        the bench cannot be reached, or has gone silent.
    """
    interlocks = Interlocks(rig)
    with held(rig, "'rigctl monitor'", how) as lock, opened(rig, how) as backend, Signals() as signals:
        clock = backend.clock
        backend.start(rate)
        newest = clock.now()
        while not signals.count:
            if lock is not None:
                lock.beat()
                if lock.poll():
                    raise RigctlError("another program has taken the bench over", exit_code=ExitCode.FAILED)
            sample = backend.next_sample(min(_RESPONSE * clock.speed, interlocks.silence_limit(1.0 / rate)))
            if sample is not None:
                newest = sample.time
                row = (sample.time, -1.0, *sample.values, *sample.commands)
                yield Reading(sample, interlocks.check(row))
                continue
            silence = interlocks.check_silence(clock.now(), newest, 1.0 / rate)
            if silence is not None:
                raise RigctlError(silence.message, exit_code=ExitCode.FAILED)


def _plan_of_jog(rig: Rig, actuator: str, value: str, duration: str | None) -> Plan:
    """The jog as a procedure, so that it is checked and carried out like every other step."""
    if actuator not in rig.actuators:
        raise unknown_name("actuator", actuator, rig.actuators)
    setting: dict[str, Any] = {"values": {actuator: value}}
    steps: list[dict[str, Any]] = [{"set": setting}]
    if duration is not None:
        setting["for"] = duration
    elif rig.actuators[actuator].by == "driven":
        steps.append({"prompt": f"{actuator} is at {value}; Enter brings it back"})
    text = json.dumps({"procedure": f"jog {actuator}", "steps": steps})  # JSON is YAML
    try:
        return expand(parse_procedure(text), rig)
    except RigctlError as error:
        error.where = Location()
        raise
