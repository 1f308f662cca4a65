"""A bench of several devices without real time: each is silent, and reads what it reads, at given times."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from rigctl.backends.combined.merging import Merging
from rigctl.backends.errors import OutputsNotSafe
from rigctl.backends.protocol import Backend, CommandReceipt, Notice, PendingCommand, Sample
from rigctl.rig import Rig
from rigctl.testing import ScriptedClock


@dataclass
class Part:
    """A device: whether it is silent at a time, and what it reads."""

    silent: Callable[[float], bool] = lambda _: False
    value: Callable[[float], float] = lambda _: 1.0
    first: float = 0.0  # s, until which it has not been read
    due: float = 0.0
    fastest: float = math.inf  # Hz
    late: Callable[[float], float] = lambda _: 0.0  # s, by which a reading comes after the time it was due
    commands: dict[str, float] = field(default_factory=dict)


class InVirtualTime:
    """A bench of several devices whose samples are made when they are due."""

    timed = True
    without_host = "nothing"
    identity: Mapping[str, str] = {"kind": "devices"}

    def __init__(self, rig: Rig, clock: ScriptedClock) -> None:
        self.rig, self.clock = rig, clock
        self.devices: Mapping[str, Backend] = {}
        self.parts = {name: Part() for name in rig.parts}
        self.outputs_read = self.outputs_answered = frozenset(rig.actuators)
        self.given: list[tuple[float, float]] = []
        self.notices: list[Notice] = []
        self.unsafe: OutputsNotSafe | None = None
        self._merging = Merging(rig)
        self._rate = 10.0

    def open(self) -> None: ...

    def close(self) -> None: ...

    def start(self, rate: float) -> None:
        self._merging.start(rate)
        self._rate = rate

    def next_sample(self, timeout: float) -> Sample | None:
        give_up = self.clock.now() + timeout
        while True:
            name, part = min(self.parts.items(), key=lambda one: one[1].due + one[1].late(one[1].due))
            time = part.due + part.late(part.due)
            if time > give_up:
                self.clock.sleep_until(give_up)
                return None
            part.due += 1.0 / min(self._rate, part.fastest)
            self.clock.sleep_until(time)
            if time < part.first or part.silent(time):
                continue
            commands = tuple(part.commands.get(one, 0.0) for one in self.rig.parts[name].layout.commands)
            return self._merging.sample(name, Sample(time, (part.value(time),), commands))

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        self.parts[self.rig.device_of(actuator)].commands[actuator] = value
        self.given.append((self.clock.now(), value))
        return PendingCommand.answered(CommandReceipt(self.clock.now(), actuator, value))

    def take_receipts(self) -> list[CommandReceipt]:
        return []

    def take_notices(self) -> list[Notice]:
        taken, self.notices = self.notices, []
        return taken

    def safe(self) -> None:
        if self.unsafe is not None:
            raise self.unsafe
        for part in self.parts.values():
            part.commands.clear()
