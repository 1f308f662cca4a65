"""A record that lacks much of what the procedure asked for is not complete, on a device that is too slow."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.backends.lines.bench import LineBench
from rigctl.clock import VirtualClock
from rigctl.dataset import open_run
from rigctl.files.shipped import shipped
from rigctl.testing import RunLog, VirtualBench
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


def run(bench: VirtualBench, delay: float, more: str = "") -> RunLog:
    """A run on a board that takes `delay` s for each of its answers: up to four to a sample."""
    clock, rig = VirtualClock(), bench.rig()
    port = MemoryPort(Sketch(clock.now), clock)
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
    done = run(bench, 0.3)
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
