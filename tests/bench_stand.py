"""One run on each kind of bench, in virtual time, with an independent record of the outputs.

The outputs are observed independently of rigctl: at the pins of the emulated chip, in the lines received by
the stand-in of the two-heater board, or at the plant's own switch.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from rigctl.backends.emulated.board import EmulatedBoard
from rigctl.backends.registry import create_backend
from rigctl.backends.simulated.roles_plant import RolesPlant
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, parse_rig
from rigctl.runner.snapshot import View
from rigctl.testing import ScriptedClock, line_bench
from run_workshop import Done, Workshop
from tclab_board import MemoryPort, Sketch


@dataclass
class Stand:
    """A bench that is about to be run.

    Attributes
    ----------
    seen: when an output changed, which one, and to what: bench time in s and SI.
    """

    kind: str
    workshop: Workshop
    monkeypatch: pytest.MonkeyPatch
    clock: ScriptedClock = field(default_factory=ScriptedClock)
    seen: list[tuple[float, str, float]] = field(default_factory=list)
    port: MemoryPort | None = None
    board: EmulatedBoard | None = None
    opened: int = 0  #: times that the port was opened

    @property
    def rig_text(self) -> str:
        name = {"lines": "tclab-board.yaml", "simulated": "hl32-bench.yaml"}.get(
            self.kind, "hl32-bench-uno.yaml"
        )
        return shipped("rigs", name).read_text(encoding="utf-8")

    def rig(self, *changes: tuple[str, str]) -> Rig:
        text = self.rig_text
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        return parse_rig(text)

    def signal_at(self, *times: float, number: int = signal.SIGINT) -> None:
        for time in times:
            self.clock.at(time, lambda: signal.raise_signal(number))

    def run(
        self,
        steps: str,
        rig: Rig | None = None,
        *,
        observer: Callable[[View], None] | None = None,
        **options: object,
    ) -> Done:
        chosen = rig or self.rig()
        make = {"lines": self._lines, "simulated": self._simulated, "emulated": self._emulated}[self.kind]
        backend = make(chosen, options)
        backend.open()
        return self.workshop.run(steps, rig=chosen, backend=backend, observer=observer)

    def on_after(self, time: float) -> list[tuple[float, str, float]]:
        """Every output that was switched on after a time."""
        return [entry for entry in self.seen if entry[0] > time and entry[2] != 0.0]

    def is_off(self) -> bool:
        newest = {name: value for _, name, value in self.seen}
        return not any(newest.values())

    # --- benches ---

    def _simulated(self, rig: Rig, options: dict[str, object]) -> Any:
        before = RolesPlant.switch

        def switch(plant: RolesPlant, actuator: str, value: float) -> None:
            if rig.actuators[actuator].by == "driven":
                self.seen.append((plant._time, actuator, value))
            before(plant, actuator, value)

        self.monkeypatch.setattr(RolesPlant, "switch", switch)
        chosen = {"plant": "roles", "noise": "off", "quantised": "off", **options}
        return create_backend(rig, "simulated", self.clock, chosen)

    def _emulated(self, rig: Rig, options: dict[str, object]) -> Any:
        before = EmulatedBoard._switch

        def switch(board: EmulatedBoard, time: float, pin: tuple[str, int]) -> None:
            self.board = board
            heater, extend, retract = board.outputs
            if pin == ("D", 4):
                self.seen.append((time, "heater", float(heater)))
            else:
                self.seen.append((time, "valve", float(extend) - float(retract)))
            before(board, time, pin)

        self.monkeypatch.setattr(EmulatedBoard, "_switch", switch)
        return create_backend(
            rig, "emulated", self.clock, {"plant": "roles", "noise": "off", "seed": 1, **options}
        )

    def _lines(self, rig: Rig, options: dict[str, object]) -> Any:
        assert not options
        sketch = Sketch(self.clock.now)
        port = self.port = MemoryPort(sketch, self.clock)
        take = sketch.take

        def watched(data: bytes) -> bytes:
            before, answer = sketch.heaters, take(data)
            for name, old, new in zip(("heater_1", "heater_2"), before, sketch.heaters, strict=True):
                if old != new:
                    self.seen.append((self.clock.now(), name, new / 100.0))
            return answer

        sketch.take = watched  # type: ignore[method-assign]

        check = port.check

        def counted() -> None:
            check()
            self.opened += 1

        port.check = counted  # type: ignore[method-assign]
        return line_bench(rig, port)
