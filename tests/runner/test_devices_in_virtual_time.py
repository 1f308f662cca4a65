"""Runs on a bench of two devices, each with gaps and faults at given times, without real time."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from devices_in_virtual_time import InVirtualTime
from rigctl.backends.errors import OutputsNotSafe
from rigctl.backends.protocol import CommandReceipt, Notice, PendingCommand
from rigctl.dataset import open_run
from rigctl.dataset.recording import samples_file
from rigctl.plan.loop import LoopSettings, LoopState
from rigctl.rig import Rig, parse_rig
from rigctl.runner.bench import Bench
from rigctl.runner.completeness import Completeness
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.recent_samples import History
from rigctl.runner.recorder import Unrecorded
from rigctl.testing import RunLog, ScriptedClock, VirtualBench

RIG = """\
name: two
monitor_rate: 10 Hz
stale_after: 1 s
devices:
  a: {kind: simulated}
  b: {kind: simulated}
channels:
  va: {device: a, unit: V, quantity: voltage}
  vb: {device: b, unit: V, quantity: voltage}
actuators:
  x: {device: a, kind: switch}
  y: {device: b, kind: switch}
safe_state: {x: off, y: off}
limits:
  too_high: {channel: vb, above: 5 V, action: stop}
"""
RECORD = "steps:\n  - record: {name: r, rate: 10 Hz, retries: 1}\n    do: [wait: 5 s]\n"


@pytest.fixture
def rig() -> Rig:
    return parse_rig(RIG)


@pytest.fixture
def bench(rig: Rig) -> InVirtualTime:
    return InVirtualTime(rig, ScriptedClock())


def run(bench: InVirtualTime, folder: Path, steps: str = RECORD) -> RunLog:
    return VirtualBench(folder).run(steps, rig=bench.rig, backend=bench)


def test_a_limit_that_is_exceeded_while_a_device_is_awaited_ends_the_run(
    bench: InVirtualTime, tmp_path: Path
) -> None:
    """It used to be lost: the watch had raised its alarm, and raised no other."""
    bench.parts["a"].silent = lambda time: 2.0 < time < 12.0
    bench.parts["b"].value = lambda time: 9.0 if time > 6.0 else 1.0
    done = run(bench, tmp_path)
    assert done.result.status == "failed"
    assert "vb is 9 V, above the limit of 5 V" in str(done.result.reason)
    assert bench.clock.now() < 12.0


def test_a_gap_of_one_device_does_not_end_the_wait_for_another(bench: InVirtualTime, tmp_path: Path) -> None:
    bench.parts["a"].silent = lambda time: 2.0 < time < 12.0
    bench.clock.at(5.0, lambda: bench.notices.append(Notice(5.0, "gap", "b: samples lost", {"device": "b"})))
    done = run(bench, tmp_path)
    assert done.result.status == "finished", done.result.reason
    assert [outcome for _, outcome in done.records] == ["interrupted", "complete"]
    assert bench.clock.now() > 12.0 + 5.0


def test_the_first_readings_of_a_slow_device_are_waited_for(bench: InVirtualTime, tmp_path: Path) -> None:
    """Rows before them used to count as readings without a value: not armed, sensor broken."""
    bench.parts["b"].first = 0.15
    done = run(bench, tmp_path, "steps: [wait: 1 s]\n")
    assert done.result.status == "finished", done.result.reason


def test_a_device_without_any_reading_is_missing_in_a_record(rig: Rig) -> None:
    counted = Completeness(rig, ["va", "vb"], 10.0, 100.0)
    for number in range(51):
        time = 100.0 + number / 10.0
        counted.add((time, 0.0, 1.0, math.nan, 0.0, 0.0), "a", possible=True)
    assert [str(lack) for lack in counted.lacks(105.0)] == ["43 of 43 samples of b (100 %)"]
    assert counted.lacks(100.5) == []  # they may still be on their way


def test_a_long_run_is_finalised_in_the_groups_in_which_it_is_read_back(
    bench: InVirtualTime, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows of several devices that wait for earlier ones used to make blocks of more rows than a group has;
    every run beyond 131 072 rows then ended with 'what was read back is not what was written'."""
    monkeypatch.setattr(samples_file, "GROUP_ROWS", 64)
    done = run(bench, tmp_path, RECORD.replace("5 s", "100 s"))
    assert done.result.status == "finished", done.result.reason
    found = open_run(done.result.folder).table("samples")
    assert len(found["time"]) > 1000
    assert np.all(np.diff(found["time"].to_numpy()) > 0.0)


def test_each_device_without_contact_is_named_with_its_outputs(bench: InVirtualTime) -> None:
    """Also one whose outputs were safe when it was last seen, beside one with an output that may be on."""
    bench.unsafe = OutputsNotSafe("nothing answers", {"x": 1.0}, bench.clock.date())
    writer = Unrecorded(lambda *_: None)
    seen = Bench(bench.rig, bench, writer, AutomaticOperator(), History({"a": {}, "b": {}}, 0.0))
    seen.make_safe("a test")
    assert seen.unconfirmed is not None
    assert seen.unconfirmed.startswith("a: x on, b: y (safe when last seen at ")


def test_a_loop_acts_at_the_readings_of_its_channel_not_at_rows_of_other_devices(tmp_path: Path) -> None:
    """A repeated value just before the next reading used to be taken for it, which then came too early."""
    slow = """{kind: modbus, port: "10.0.0.1:502", modbus: {fastest: 10 Hz,
      channels: {vb: {table: input, address: 2, type: int16}}, actuators: {y: {table: coil, address: 0}}}}"""
    level = 'x: {device: a, kind: level, unit: "%", low: 0 %, high: 100 %}'
    text = RIG.replace("b: {kind: simulated}", f"b: {slow}").replace("x: {device: a, kind: switch}", level)
    text = text.replace("{x: off,", "{x: 0 %,")
    bench = InVirtualTime(parse_rig(text), ScriptedClock())
    bench.parts["a"].due, bench.parts["b"].fastest = 0.0095, 10.0  # one row 0.5 ms before each reading of b
    bench.parts["b"].value = lambda time: 1.0 + 0.1 * math.sin(time)
    loop = "{actuator: x, channel: vb, to: 3 V, gain: 20 %/V, integral: 4 %/(V*s), rate: 10 Hz, for: 3 s}"
    done = run(
        bench, tmp_path, f"steps:\n  - record: {{name: r, rate: 100 Hz}}\n    do:\n      - control: {loop}\n"
    )
    assert done.result.status == "finished", done.result.reason
    at = [time for time, value in bench.given if value != 0.0]
    assert len(at) > 25
    assert at == pytest.approx([round(time, 1) for time in at], abs=1e-6)


def test_a_loop_uses_every_reading_of_a_device_that_is_a_little_late_now_and_then(
    tmp_path: Path,
) -> None:
    """The reading after a late one was too early by as much, and was left out: the output stood still."""
    level = 'x: {device: a, kind: level, unit: "%", low: 0 %, high: 100 %}'
    text = RIG.replace("x: {device: a, kind: switch}", level).replace("{x: off,", "{x: 0 %,")
    bench = InVirtualTime(parse_rig(text), ScriptedClock())
    bench.parts["a"].late = lambda due: 0.002 if round(10.0 * due) % 7 == 3 else 0.0
    bench.parts["a"].value = lambda time: 1.0 + 0.1 * math.sin(time)
    loop = "{actuator: x, channel: va, to: 3 V, gain: 20 %/V, integral: 4 %/(V*s), rate: 10 Hz, for: 10 s}"
    done = run(
        bench, tmp_path, f"steps:\n  - record: {{name: r, rate: 10 Hz}}\n    do:\n      - control: {loop}\n"
    )
    assert done.result.status == "finished", done.result.reason
    at = np.array([time for time, value in bench.given if value != 0.0])
    assert np.diff(at) == pytest.approx(0.1, abs=0.0021)
    assert at.size >= 99
    kept = open_run(done.result.folder).record(0).measures
    assert kept["control_jitter_p99"] == pytest.approx(0.002, abs=1e-6)


class _WithBoard(InVirtualTime):
    """Its device `b` executes a loop by itself."""

    running = False

    def cannot_regulate(self, loop: LoopSettings) -> str:
        return ""

    def regulate(self, loop: LoopSettings) -> PendingCommand:
        self.running = True
        return PendingCommand.answered(CommandReceipt(self.clock.now(), loop.actuator, loop.low))

    def loop_state(self, ahead: float | None = None) -> LoopState:
        return LoopState(self.running, None)

    def stop_regulating(self, actuator: str) -> PendingCommand:
        self.running = False
        return PendingCommand.answered(CommandReceipt(self.clock.now(), actuator, 0.0))

    def safe(self) -> None:
        self.running = False
        super().safe()


def test_a_loop_on_a_board_has_settled_by_its_own_readings_alone(tmp_path: Path) -> None:
    """Rows of a faster device repeated a reading within the band until just before one that is not."""
    slow = """{kind: modbus, port: "10.0.0.1:502", modbus: {fastest: 1 Hz,
      channels: {vb: {table: input, address: 2, type: int16}},
      actuators: {y: {table: holding, address: 0}}}}"""
    text = RIG.replace("b: {kind: simulated}", f"b: {slow}")
    text = text.replace(
        "y: {device: b, kind: switch}", 'y: {device: b, kind: level, unit: "%", low: 0 %, high: 100 %}'
    )
    text = text.replace("y: off", "y: 0 %").replace("stale_after: 1 s", "stale_after: 5 s")
    bench = _WithBoard(parse_rig(text), ScriptedClock())
    bench.parts["b"].fastest = 1.0
    bench.parts["b"].value = lambda time: 3.0 if 1.5 < time < 2.5 or time > 5.5 else 1.0
    loop = (
        "{actuator: y, channel: vb, to: 3 V, gain: 20 %/V, integral: 4 %/(V*s), rate: 1 Hz, within: 0.1 V, "
        "settle: 0.5 s, timeout: 20 s, where: auto}"
    )
    done = run(
        bench, tmp_path, f"steps:\n  - record: {{name: r, rate: 100 Hz}}\n    do:\n      - control: {loop}\n"
    )
    assert done.result.status == "finished", done.result.reason
    assert bench.clock.now() > 6.0


def test_a_move_stops_where_it_should_with_a_position_that_is_read_seldom(tmp_path: Path) -> None:
    """Rows of a faster device repeat a position: the speed found from them was wrong, and the stop late."""
    slow = """{kind: modbus, port: "10.0.0.1:502", modbus: {fastest: 10 Hz,
      channels: {at: {table: input, address: 2, type: int16}}, actuators: {y: {table: coil, address: 0}}}}"""
    text = RIG.replace("b: {kind: simulated}", f"b: {slow}").replace("kind: switch}\n  y", "VALVE}\n  y")
    text = text.replace("VALVE", "kind: directional_valve").replace("{x: off,", "{x: neutral,")
    text = text.replace(
        "vb: {device: b, unit: V, quantity: voltage}", "at: {device: b, unit: mm, quantity: position}"
    )
    text = text[: text.index("limits:")] + "roles:\n"
    text += "".join(
        f"  {way}: {{actuator: x, value: {way}, position: at}}\n" for way in ("extend", "retract")
    )
    bench = InVirtualTime(parse_rig(text), ScriptedClock())
    bench.parts["b"].fastest = 10.0
    place = [(0.0, 0.0, 0.0)]  # time, position, speed

    def position(time: float) -> float:
        since, at, speed = place[-1]
        return at + speed * (time - since)

    def command(actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        now = bench.clock.now()
        if actuator == "x":
            place.append((now, position(now), 0.02 * value))
            if duration is not None:
                bench.clock.at(now + duration, lambda: command(actuator, 0.0))
        return given(actuator, value, duration=duration)

    given, bench.command = bench.command, command  # type: ignore[method-assign]
    bench.parts["b"].value = position
    done = run(bench, tmp_path, "steps:\n  - extend: {to: 100 mm, within: 1 mm, timeout: 20 s}\n")
    assert done.result.status == "finished", done.result.reason
    stopped = next(
        at for (_, at, speed), (_, _, before) in zip(place[1:], place, strict=False) if before and not speed
    )
    assert stopped == pytest.approx(0.0994, abs=3e-4)  # what it is assumed to coast before it
