"""Commands without an answer: outputs that may still be on are reported for every kind of step.

The two-heater board in memory, on a virtual clock; its heaters are the witness.
"""

from __future__ import annotations

import json
from pathlib import Path

from rigctl.backends.lines.bench import LineBench
from rigctl.backends.transport.port import PortLost
from rigctl.clock import VirtualClock
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig, parse_rig
from rigctl.runner.operators.requests import Order, Request
from run_workshop import Done, ScriptedControl, Workshop
from tclab_board import MemoryPort, Sketch

TCLAB = load_rig(shipped("rigs", "tclab-board.yaml"))
HEATED = "\nroles:\n  heat: {actuator: heater_1, channel: temperature_1}\n\nsafe_state:"
HEATING = "steps:\n  - heat: {to: 40 degC, within: 0.5 K, settle: 10 s, timeout: 1 h}\n"


class PortThatDies(MemoryPort):
    """The board carries a command out, and the line dies before its answer: for `outage` s, or for good."""

    def __init__(self, sketch: Sketch, clock: VirtualClock, last: str, times: int, outage: float) -> None:
        super().__init__(sketch, clock)
        self._last, self._times, self._outage = last, times, outage
        self._back = 0.0

    def write(self, data: bytes) -> None:
        if self.gone and self.clock.now() >= self._back:
            self.gone = False
        super().write(data)
        if data.decode().strip() == self._last:
            self._times -= 1
            if self._times == 0:
                self.gone, self._back = True, self.clock.now() + self._outage
                raise PortLost("the plug is pulled")


class Person(ScriptedControl):
    """Pauses at a bench time and continues the run as soon as it is paused."""

    def poll(self) -> list[Order]:
        if self.views and self.views[-1].state == "paused":
            self.orders.append((0.0, Request.CONTINUE))
        return super().poll()


def heated_rig() -> Rig:
    return parse_rig(TCLAB.text.replace("\nsafe_state:", HEATED))


def carry_out(
    folder: Path,
    steps: str,
    *,
    last: str,
    times: int = 1,
    outage: float = float("inf"),
    control: ScriptedControl | None = None,
) -> tuple[Done, Sketch]:
    rig = heated_rig()
    assert rig.backend.lines is not None
    clock = VirtualClock()
    port = PortThatDies(Sketch(clock.now), clock, last, times, outage)
    bench = LineBench(rig, rig.backend.lines, clock, lambda: port, kind="serial", reconnect=10.0)
    bench.open()
    done = Workshop(folder).run(steps, rig=rig, backend=bench, controls=[control] if control else [])
    return done, port.sketch


def require_named(done: Done, doubt: str) -> None:
    assert done.result.unconfirmed == doubt
    assert f"OUTPUTS NOT CONFIRMED SAFE: {doubt} may still be on" in str(done.result.reason)
    kept = json.loads((done.result.folder / "run.json").read_text(encoding="utf-8"))
    assert kept["unconfirmed"] == doubt
    assert [text for text in done.messages("note") if "heater_1 could not be commanded" in text]


def test_an_unanswered_first_command_of_heat_is_reported_as_possibly_on(tmp_path: Path) -> None:
    done, sketch = carry_out(tmp_path, HEATING, last="Q1 100.00")
    assert sketch.heaters == (100.0, 0.0), "the witness: it is on"
    assert done.commands("heater_1") == [], "what was never confirmed is not logged as given"
    require_named(done, "heater_1 100 %")


def test_an_unanswered_command_after_a_pause_is_reported_as_possibly_on(tmp_path: Path) -> None:
    steps = "steps:\n  - set: {heater_1: 60 %}\n  - wait: 100 s\n"
    person = Person([(10.0, Request.PAUSE)])
    done, sketch = carry_out(tmp_path, steps, last="Q1 60.00", times=2, control=person)
    assert sketch.heaters == (60.0, 0.0)
    require_named(done, "heater_1 60 %")


def test_an_output_is_reported_as_possibly_on_after_a_wrong_answer(tmp_path: Path) -> None:
    """The device may have set another value; if it then cannot be made safe, the value is unknown."""
    rig = heated_rig()
    assert rig.backend.lines is not None
    clock = VirtualClock()
    port = MemoryPort(Sketch(clock.now), clock)
    bench = LineBench(rig, rig.backend.lines, clock, lambda: port, kind="serial", reconnect=10.0)
    bench.open()
    port.sketch.odd["Q1 60.00"] = b"55.00\r\n"
    port.sketch.always["X"] = b"\r\n"
    port.sketch.always["Q1 0.00"] = b"55.00\r\n"
    steps = "steps:\n  - set: {heater_1: 60 %}\n  - wait: 100 s\n"
    done = Workshop(tmp_path).run(steps, rig=rig, backend=bench)
    assert done.result.unconfirmed == "heater_1 60 %"


def test_an_output_made_safe_after_reconnecting_is_not_reported(tmp_path: Path) -> None:
    done, sketch = carry_out(tmp_path, HEATING, last="Q1 100.00", outage=3.0)
    assert sketch.heaters == (0.0, 0.0)
    assert done.result.unconfirmed is None
