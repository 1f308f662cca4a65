"""An actuator with a `max_rate` is nowhere commanded faster, but to its safe state."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.planning import preview
from rigctl.rig import parse_rig
from rigctl.runner.operators.requests import Order, Request
from rigctl.testing import ScriptedControl, VirtualBench, assert_finished

SLOW = 'heater_1: {kind: level, unit: "%", low: 0 %, high: 100 %, max_rate: 5 %/s,'


@pytest.fixture
def bench(tmp_path: Path) -> VirtualBench:
    return VirtualBench(tmp_path, shipped("rigs", "heater-board.yaml"))


def slow(bench: VirtualBench) -> object:
    return bench.rig('heater_1: {kind: level, unit: "%", low: 0 %, high: 100 %,', SLOW)


def test_set_takes_its_time(bench: VirtualBench) -> None:
    steps = "steps:\n  - set: {heater_2: 30 %, heater_1: 60 %}\n  - set: {heater_1: 50 %}\n"
    done = bench.run(steps, rig=slow(bench))  # type: ignore[arg-type]
    assert_finished(done)
    *commands, (end, last) = done.commands("heater_1")
    assert max(abs(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(commands)) <= 0.05 * 1.01
    assert max(value for _, value in commands) == pytest.approx(0.6)
    assert commands[-1][1] == pytest.approx(0.5)
    assert commands[-1][0] - commands[0][0] == pytest.approx(12.0 + 2.0, abs=0.3)
    assert (last, end) == (0.0, pytest.approx(commands[-1][0], abs=0.1))  # the safe state follows at once
    assert [value for _, value in done.commands("heater_2")] == [0.3, 0.0]


def test_the_preview_allows_for_it(bench: VirtualBench) -> None:
    plan = bench.plan("steps:\n  - set: {heater_1: 60 %}\n  - set: {heater_1: 50 %}\n", slow(bench))  # type: ignore[arg-type]
    assert preview(plan).seconds == pytest.approx(14.0)


def test_a_pulse_of_it_is_refused(bench: VirtualBench) -> None:
    with pytest.raises(RigctlError, match="may not jump, as its max_rate says"):
        bench.plan("steps:\n  - set: {values: {heater_1: 60 %}, for: 3 s}\n", slow(bench))  # type: ignore[arg-type]


class Person(ScriptedControl):
    """Lets the run go on as soon as it is paused."""

    def poll(self) -> list[Order]:
        if self.views and self.views[-1].state == "paused":
            self.orders.append((0.0, Request.CONTINUE))
        return super().poll()


def test_a_pause_is_left_at_that_rate(bench: VirtualBench) -> None:
    control = Person([(15.0, Request.PAUSE)])
    steps = "steps:\n  - set: {heater_1: 60 %}\n  - wait: 20 s\n"
    done = bench.run(steps, rig=slow(bench), control=control)  # type: ignore[arg-type]
    assert_finished(done)
    after = [(time, value) for time, value in done.commands("heater_1") if time > 15.5]
    rising = [(a, b) for a, b in pairwise(after) if b[1] > a[1]]
    assert len(rising) > 50
    assert all((b[1] - a[1]) / (b[0] - a[0]) <= 0.05 * 1.01 for a, b in rising)


@pytest.mark.parametrize(("text", "given"), [("max_rate: 5 bar/s", "5 bar/s"), ("max_rate: 5 %", "5 %")])
def test_a_wrong_unit_is_told_the_right_one(bench: VirtualBench, text: str, given: str) -> None:
    rig = bench.rig()
    wrong = SLOW.replace("max_rate: 5 %/s", text)
    with pytest.raises(RigctlError) as caught:
        parse_rig(rig.text.replace('heater_1: {kind: level, unit: "%", low: 0 %, high: 100 %,', wrong))
    assert f"got '{given}'; expected a change per second, e.g. '5 %/s'" in str(caught.value)
