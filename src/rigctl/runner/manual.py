"""Manual operation: one actuator is moved, the channels are watched. Nothing is recorded.

`jog` makes a procedure of one or two steps and gives it to the same `run` as any other, so that limits,
locks, endings and the safe state hold by hand too; only its recorder keeps nothing. `watch` moves nothing
and has no steps: it is a loop of its own over samples and interlocks, as there is nothing to walk.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rigctl.backends.protocol import Backend, Combined, Polled, Sample
from rigctl.errors import ExitCode, RigctlError, unknown_name
from rigctl.plan import Plan
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import Rig
from rigctl.runner.bench_access import UNREAL, Access, held, opened
from rigctl.runner.interlocks import Alarm, Interlocks
from rigctl.runner.launch import Launch
from rigctl.runner.operators.control_thread import beside
from rigctl.runner.operators.signals import Signals
from rigctl.runner.recorder import Unrecorded
from rigctl.runner.session import RunResult, run

#: longest response time to Ctrl-C, s of wall time
_RESPONSE = 0.1

OnEvent = Callable[[float, str, Mapping[str, Any]], None]
OnSample = Callable[[Sample], None]


@dataclass(frozen=True)
class DeviceState:
    """One of several devices, while the bench is monitored.

    Parameters
    ----------
    identity: what is known of it: kind, address and what it says of itself.
    own_clock: whether it dates its readings with a clock of its own, which is compared with this computer's.
    answers_in: s, the shortest time that its queries for a sample have taken; NaN where it sends by itself.
    age: s, of its newest reading; NaN before the first one.
    stale_after: s, silence that is a fault at the present rate: that after which its first channel is stale.
    """

    identity: Mapping[str, str]
    own_clock: bool
    answers_in: float
    age: float
    stale_after: float


@dataclass(frozen=True)
class Reading:
    """One sample of a bench that is only monitored, the alarms that it raised or cleared, and the messages of
    the bench since the last one, such as a reply that the rig file does not expect; and its devices where it
    has several."""

    sample: Sample
    alarms: Sequence[Alarm]
    notices: Sequence[str] = ()
    devices: Mapping[str, DeviceState] = field(default_factory=dict)


class _Watched(Unrecorded):
    """Keeps nothing, and shows every sample."""

    def __init__(self, rig: Rig, on_event: OnEvent, on_sample: OnSample) -> None:
        super().__init__(on_event)
        self._rig = rig
        self._newest = [math.nan] * len(rig.layout.columns)
        self._on_sample = on_sample

    def append(self, row: Sequence[float]) -> None:
        """Show a sample; its row also has the number of the record, of which there is none."""
        columns, newest = self._rig.layout.columns, self._newest
        for part in self._rig.parts.values():  # of several devices, a row is the reading of one
            own = [columns.index(name) for name in part.channels]
            if len(self._rig.parts) == 1 or any(row[column] == row[column] for column in own):
                for column in own:
                    newest[column] = row[column]
        first = 2 + len(self._rig.layout.channels)
        self._on_sample(Sample(row[0], tuple(newest[2:first]), tuple(row[first:])))


def jog(
    rig: Rig,
    actuator: str,
    value: str,
    duration: str | None,
    how: Launch,
    on_event: OnEvent,
    on_sample: OnSample | None = None,
) -> RunResult:
    """Command one actuator, for a time or until the operator ends it; every output is safe afterwards.

    Interlocks act as in a run: a limit that is already exceeded prevents it, one that trips ends it. A
    `RigctlError` of `on_sample` ends it, too.

    Raises
    ------
    RigctlError
        no such actuator, a value that it cannot take, or the bench cannot be reached.
    """
    plan = _plan_of_jog(rig, actuator, value, duration)
    with held(rig, f"'rigctl jog {actuator}'", how) as lock, opened(rig, how) as backend:
        controls = [*how.controls, *([beside(lock, backend.clock)] if lock is not None else [])]
        return run(
            plan,
            backend,
            Unrecorded(on_event) if on_sample is None else _Watched(rig, on_event, on_sample),
            operator=how.operator,
            controls=controls,
            observer=how.observer,
        )


def needs_person(rig: Rig, actuator: str, duration: str | None, how: Access) -> bool:
    """Whether somebody has to answer during a jog: to end it, or because the actuator is turned by hand.

    The operator of a bench that is not real is simulated too.
    """
    known = rig.actuators.get(actuator)
    if known is None:
        return False
    if known.by == "operator":
        return (how.backend or rig.kind) not in UNREAL
    return duration is None


def watch(rig: Rig, how: Access, rate: float) -> Generator[Reading, None, None]:
    """Samples of a bench at rest, until the caller stops or somebody interrupts.

    Raises
    ------
    RigctlError
        the bench cannot be reached, or has gone silent.
    """
    with held(rig, "'rigctl monitor'", how) as lock, opened(rig, how) as backend, Signals() as signals:
        rig = rig if isinstance(backend, Combined) else rig.undivided
        interlocks = Interlocks(rig)
        clock = backend.clock
        backend.start(rate)
        # From here on as `rigctl.runner.sampling`, without journal and steps: a sample, its alarms, or a
        # silence.
        newest = began = clock.now()
        read_at: dict[str, float] = {}  # s, time of each device's newest reading
        while not signals.count:
            # The heartbeat comes from this loop, as in a run: a program that hangs must not keep the bench.
            if lock is not None:
                lock.beat()
                if lock.poll():
                    raise RigctlError("another program has taken the bench over", exit_code=ExitCode.FAILED)
            silence_limit = interlocks.silence_limit(1.0 / rate)
            silence = None
            sample = backend.next_sample(min(_RESPONSE * clock.speed, silence_limit))
            if sample is None and clock.now() - newest >= silence_limit:  # this computer may have stood still
                sample = backend.next_sample(0.0)
            if sample is not None:
                newest, read = sample.time, sample.read
                row = (read.time, -1.0, *read.values, *read.commands)
                notices = tuple(
                    one.message for one in backend.take_notices() if one.kind in ("fault", "note")
                )
                read_at[sample.device] = read.time
                ages = {name: newest - time for name, time in read_at.items()}
                states = _device_states(rig, backend, rate, ages)
                yield Reading(sample, interlocks.check(row, sample.device), notices, states)
            elif not rig.devices:
                silence = interlocks.check_silence(clock.now(), newest, 1.0 / rate)
            if rig.devices:
                # those that are still to be fetched are not counted as missing
                _, silence = interlocks.check_devices(clock.now() if sample is None else newest, began, rate)
            if silence is not None:
                raise RigctlError(silence.message, exit_code=ExitCode.FAILED)


def _device_states(
    rig: Rig, backend: Backend, rate: float, ages: Mapping[str, float]
) -> dict[str, DeviceState]:
    """The state of each of several devices; none of a bench that has one."""
    if not isinstance(backend, Combined):
        return {}
    states = {}
    for name, bench in backend.devices.items():
        described, known = rig.devices[name], backend.identity
        states[name] = DeviceState(
            {key.removeprefix(f"{name}."): text for key, text in known.items() if key.startswith(f"{name}.")},
            described.lines is None and described.kind in ("serial", "emulated"),
            (isinstance(bench, Polled) and bench.sample_takes) or math.nan,
            ages.get(name, math.nan),
            rig.silence_limit(name, rate),
        )
    return states


def _plan_of_jog(rig: Rig, actuator: str, value: str, duration: str | None) -> Plan:
    """The jog as a procedure, so that it is checked and carried out like every other step."""
    if actuator not in rig.actuators:
        raise unknown_name("actuator", actuator, rig.actuators)
    setting: dict[str, Any] = {"values": {actuator: value}}
    steps: list[dict[str, Any]] = [{"set": setting}]
    described = rig.actuators[actuator]
    if duration is not None and described.by == "driven" and described.max_rate is not None:
        steps.append({"wait": duration})  # once it has arrived at its max_rate; a pulse would be a jump
    elif duration is not None:
        setting["for"] = duration
    elif described.by == "driven":
        steps.append({"prompt": f"{actuator} is at {value}; Enter brings it back"})
    text = json.dumps({"procedure": f"jog {actuator}", "steps": steps})  # JSON is YAML
    return expand(parse_procedure(text, generated=True), rig)
