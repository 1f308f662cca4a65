"""Runs on the emulated board whose line and chip can be disturbed at given times; virtual time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from rigctl.backends.arduino.bench import ArduinoBench
from rigctl.backends.emulated import create as creation
from rigctl.backends.emulated.board import EmulatedBoard
from rigctl.backends.emulated.port import EmulatedPort
from rigctl.clock import Clock, VirtualClock
from rigctl.dataset import open_run, verify
from rigctl.errors import ExitCode
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig, parse_rig
from run_workshop import Done, Workshop

#: a line from the board, at bench time -> the lines that arrive
Filter = Callable[[bytes, float], list[bytes]]


@dataclass
class Script:
    """The scheduled faults of the board and its line."""

    actions: list[tuple[float, Callable[[EmulatedBoard], object]]] = field(default_factory=list)
    arriving: Filter = field(default=lambda line, _: [line])
    boards: list[EmulatedBoard] = field(default_factory=list)
    ports: list[EmulatedPort] = field(default_factory=list)

    def at(self, time: float, action: Callable[[EmulatedBoard], object]) -> None:
        self.actions.append((time, action))

    @property
    def board(self) -> EmulatedBoard:
        return self.boards[-1]


class DisturbedPort:
    """The emulated board's port, with the disturbances of the script."""

    name = EmulatedPort.name

    def __init__(self, port: EmulatedPort, clock: Clock, script: Script) -> None:
        self._port = port
        self._clock = clock
        self._script = script
        self._rest = b""

    def write(self, data: bytes) -> None:
        self._act()
        self._port.write(data)

    def read(self, until: float) -> bytes:
        due = min((time for time, _ in self._script.actions), default=until)
        data = self._port.read(min(until, max(due, self._clock.now())))
        self._act()
        *lines, self._rest = (self._rest + data).split(b"\n")
        now = self._clock.now()
        return b"".join(kept for line in lines for kept in self._script.arriving(line + b"\n", now))

    def close(self) -> None:
        self._port.close()

    def _act(self) -> None:
        script, now = self._script, self._clock.now()
        due = [action for time, action in script.actions if time <= now]
        script.actions = [(time, action) for time, action in script.actions if time > now]
        for action in due:
            action(script.board)


def with_driven_valve(text: str) -> str:
    """The rig file with a proportional relief valve, on the board's PWM."""
    for old, new in (
        ("    kind: level\n    by: operator\n", "    kind: level\n"),
        ("    prompt: Turn the relief valve until the supply pressure reads\n", ""),
        ("  valve: neutral\n", "  valve: neutral\n  relief_valve: 10 bar\n"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    return text


@dataclass
class BoardWorkshop:
    """Carries out procedures on the emulated board, with the plain plant behind it."""

    workshop: Workshop
    monkeypatch: pytest.MonkeyPatch
    script: Script = field(default_factory=Script)

    driven: bool = False  # the relief valve is a proportional one, on the board's PWM

    def rig(self) -> Rig:
        path = shipped("rigs", "hl32-bench-uno.yaml")
        if not self.driven:
            return load_rig(path)
        return parse_rig(with_driven_valve(path.read_text(encoding="utf-8")))

    def bench(self, **options: object) -> ArduinoBench:
        """A bench on the board, not yet open."""

        def disturbed(board: EmulatedBoard, clock: Clock, origin: float, link: Any) -> DisturbedPort:
            if board not in self.script.boards:
                self.script.boards.append(board)
            self.script.ports.append(EmulatedPort(board, clock, origin, link))
            return DisturbedPort(self.script.ports[-1], clock, self.script)

        self.monkeypatch.setattr(creation, "EmulatedPort", disturbed)
        return creation.create(self.rig(), VirtualClock(), {"plant": "roles", "seed": 1, **options})

    def run(self, steps: str, **options: object) -> Done:
        """A complete run, after which data are complete and outputs off in every case."""
        bench = self.bench(**options)
        bench.open()
        done = self.workshop.run(steps, rig=self.rig(), backend=bench)
        board = self.script.board
        if any(board.outputs):  # the host could not reach it: its own watchdog has to act
            board.run_to(board.time + 2.1)
        assert board.outputs == (False, False, False)
        assert not board.shorted
        assert verify(done.result.folder).good
        return done

    def failure(self, steps: str, cause: str, **options: object) -> Done:
        """A run that fails; its last line and its events name the cause."""
        done = self.run(steps, **options)
        assert (done.result.status, done.result.exit_code) == ("failed", ExitCode.FAILED)
        assert cause in done.result.reason, done.result.reason
        told = [text for kind in ("fault", "alarm", "gap", "note") for text in done.messages(kind)]
        assert any(cause in text for text in told), told
        return done


def sample_times(done: Done) -> list[float]:
    """When the samples of a run's records were taken, s."""
    samples = open_run(done.result.folder).samples()
    return [float(time) for time in samples["time"][samples["record"] >= 0]]
