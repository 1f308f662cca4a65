"""A record that lacks much of what the procedure asked for is not complete, on a device that is too slow."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from rigctl.backends.lines.bench import LineBench
from rigctl.dataset import open_run
from rigctl.files.shipped import shipped
from rigctl.testing import RunLog, ScriptedClock, VirtualBench
from tclab_board import MemoryPort, Sketch

STEPS = """\
steps:
  - record: {name: up, rate: 4 HzMORE}
    do:
      - set: {heater_1: 60 %}
      - wait: 8 s
"""


@pytest.fixture
def bench(tmp_path: Path) -> VirtualBench:
    return VirtualBench(tmp_path, shipped("rigs", "tclab-board.yaml"))


def run(bench: VirtualBench, delay: float, more: str = "", since: float = 0.0) -> RunLog:
    """A run on a board that takes `delay` s for each answer since a time; up to four make a sample."""
    clock, rig = ScriptedClock(), bench.rig()
    port = MemoryPort(Sketch(clock.now), clock)
    if since:
        clock.at(since, lambda: setattr(port, "delay", delay))
    else:
        port.delay = delay
    assert rig.backend.lines is not None
    device = LineBench(rig, rig.backend.lines, clock, lambda: port, kind="serial")
    device.open()
    return bench.run(STEPS.replace("MORE", more), rig=rig, backend=device)


def test_a_device_that_keeps_pace_gives_a_complete_record(bench: VirtualBench) -> None:
    done = run(bench, 0.02)
    assert [outcome for _, outcome in done.records] == ["complete"]
    assert done.result.folder is not None
    assert open_run(done.result.folder).records["missing"].tolist() == [0.0]


def test_a_record_with_two_thirds_of_its_samples_missing_is_not_complete(bench: VirtualBench) -> None:
    done = run(bench, 0.3, since=4.0)
    assert [outcome for _, outcome in done.records] == ["interrupted"]
    assert done.result.status == "failed"
    assert "lacks" in str(done.result.reason)
    assert "samples" in str(done.result.reason)
    assert "more than 5 %" in str(done.result.reason)


def test_what_a_procedure_accepts_is_complete_and_stated(bench: VirtualBench) -> None:
    done = run(bench, 0.3, ", most_missing: 80 %")
    assert [outcome for _, outcome in done.records] == ["complete"]
    assert done.result.folder is not None
    (missing,) = open_run(done.result.folder).records["missing"]
    assert 0.5 < missing < 0.8


@pytest.mark.parametrize(("stops", "outcome"), [("3 s", "interrupted"), ("60 s", "complete")])
def test_samples_that_are_missing_at_the_end_of_a_record_count(
    tmp_path: Path, stops: str, outcome: str
) -> None:
    """Only the time up to the newest sample used to count: three seconds of eight were a complete record."""
    bench = VirtualBench(tmp_path)
    rig = bench.rig().model_copy(update={"stale_after": 100.0})  # a patient one: this silence is no fault
    steps = "steps:\n  - record: {name: up, rate: 10 Hz}\n    do: [wait: 8 s]\n"
    done = bench.run(steps, rig=rig, options={"faults": (f"samples_stop@{stops}",)})
    assert [each for _, each in done.records] == [outcome]
    assert bool(re.search(r"lacks 4\d of 7\d samples", str(done.result.reason))) == (outcome == "interrupted")


def test_a_record_that_a_device_is_too_slow_for_is_refused_before_anything_moves(bench: VirtualBench) -> None:
    done = run(bench, 0.3)
    assert done.result.status == "failed"
    said = "4 Hz is more than the device can deliver: a sample takes 0.6 s, which allows 1.7 Hz"
    assert f"record 'up' at 4 Hz: {said}" in str(done.result.reason)
    assert "running" not in done.states
    assert {value for _, value in done.commands("heater_1")} <= {0.0}  # the safe state of every ending
