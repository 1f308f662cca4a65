"""`rigctl.testing`: the bench and assertions for users' own tests pass and fail where they should."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from rigctl.rig import Rig, parse_rig
from rigctl.testing import (
    FakeDevice,
    FakeSerial,
    RunLog,
    ScriptedClock,
    VirtualBench,
    VirtualClock,
    assert_commanded,
    assert_finished,
    assert_outcome,
    assert_safe,
    assert_tripped,
    line_bench,
)

PULSE = """
steps:
  - set: {heater: on}
  - wait: 2 s
  - set: {heater: off}
"""
HEATER = """
name: one heater
backend:
  kind: serial
  lines:
    identify: {send: VER, reply: 'one heater {firmware}'}
    fastest: 10 Hz
    queries:
      - {send: T, reply: '{temperature}'}
    actuators:
      heater: {send: 'Q {value:.0f}', reply: '{value}'}
channels:
  temperature: {unit: degC, quantity: temperature}
actuators:
  heater: {kind: level, unit: '%', low: 0 %, high: 100 %}
safe_state: {heater: 0 %}
monitor_rate: 5 Hz
"""


@pytest.fixture
def bench(tmp_path: Path) -> VirtualBench:
    return VirtualBench(tmp_path)


@pytest.fixture
def pulse(bench: VirtualBench) -> RunLog:
    return bench.run(PULSE)


def test_assertions_pass_for_a_run_in_virtual_time(pulse: RunLog) -> None:
    assert_finished(pulse)
    assert_safe(pulse)
    (on, off) = pulse.commands("heater")
    assert_commanded(pulse, "heater", (on[0], 1.0), (on[0] + 2.0, 0.0), tolerance=0.2)
    assert off[1] == 0.0
    assert_outcome(pulse, "wait", "complete")
    assert repr(pulse) == "<RunLog 20000101-000000-test finished, 0 records>"


def test_each_failed_assertion_reports_what_was_found(pulse: RunLog, bench: VirtualBench) -> None:
    with pytest.raises(AssertionError, match=r"heater was commanded to \[\("):
        assert_commanded(pulse, "heater", (0.0, 1.0))
    with pytest.raises(AssertionError, match="'wait' ended complete, expected failed"):
        assert_outcome(pulse, "wait", "failed")
    with pytest.raises(LookupError, match="no step"):
        assert_outcome(pulse, "extend", "complete")
    with pytest.raises(AssertionError, match="did not trip"):
        assert_tripped(pulse, "oil_too_hot")
    failed = bench.run("steps:\n  - wait: {until: position > 100 mm, timeout: 1 s}\n")
    with pytest.raises(AssertionError, match=r"exit code 1: .*did not come true"):
        assert_finished(failed)
    left_on = RunLog(pulse.result, pulse.log[: pulse.log.index(pulse.events("command")[1])], pulse.rig)
    with pytest.raises(AssertionError, match="heater was left at"):
        assert_safe(left_on)


def test_a_trip_of_a_limit_can_be_asserted(bench: VirtualBench) -> None:
    rig = bench.rig("oil_temperature: 20 degC", "oil_temperature: 89.9 degC")
    run = bench.run("steps:\n  - set: {heater: on}\n  - wait: 1 min\n", rig=rig)
    assert_tripped(run, "oil_too_hot")
    assert_safe(run)


def test_two_runs_in_one_folder_have_different_names(bench: VirtualBench) -> None:
    names = {bench.run(PULSE).result.summary().split()[0] for _ in range(2)}
    assert len(names) == 2


def one_heater(heater: dict[str, float]) -> FakeDevice:
    def set_heater(match: re.Match[str]) -> str:
        heater["level"] = float(match[1])
        return match[1]

    return FakeDevice(
        {"VER": "one heater 1.0", "T": lambda _: f"{20.0 + heater['level']:.1f}", r"Q (\d+)": set_heater}
    )


@pytest.fixture
def heater_rig() -> Rig:
    return parse_rig(HEATER)


def test_a_line_based_device_can_be_tested_with_a_fake_one(bench: VirtualBench, heater_rig: Rig) -> None:
    heater = {"level": 0.0}
    device = one_heater(heater)
    backend = line_bench(heater_rig, device)
    backend.open()
    steps = "steps:\n  - set: {heater: 40 %}\n  - wait: {until: temperature > 50 degC, timeout: 5 s}\n"
    run = bench.run(steps, rig=heater_rig, backend=backend)
    assert_finished(run)
    assert_safe(run)
    assert heater["level"] == 0.0
    assert "Q 40" in device.sent


def test_a_connection_lost_at_a_given_time_fails_the_run(bench: VirtualBench, heater_rig: Rig) -> None:
    clock = ScriptedClock()
    port = FakeSerial(one_heater({"level": 0.0}), clock)
    backend = line_bench(heater_rig, port)
    backend.open()

    def pull() -> None:
        port.gone = True

    clock.at(3.0, pull)
    run = bench.run("steps:\n  - set: {heater: 40 %}\n  - wait: 100 s\n", rig=heater_rig, backend=backend)
    assert run.result.status == "failed"
    with pytest.raises(AssertionError, match="not confirmed to be safe: heater"):
        assert_safe(run)


def test_a_virtual_clock_reaches_any_time_without_waiting() -> None:
    clock = VirtualClock()
    clock.sleep_until(7200.0)
    assert clock.now() == 7200.0


def test_rigctl_testing_does_not_import_pytest() -> None:
    program = "import rigctl.testing, sys; print('pytest' in sys.modules)"
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "False"
