"""The board's firmware as a generic line-based device, described only by a rig file."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.backends.emulated.create import create
from rigctl.backends.errors import BackendLost
from rigctl.backends.lines.bench import LineBench
from rigctl.clock import VirtualClock
from rigctl.dataset import Run, open_run
from rigctl.errors import ExitCode, RigctlError
from rigctl.files.shipped import shipped
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig, load_rig
from rigctl.runner.bench_access import clock_for
from rigctl.runner.launch import Launch, launch
from rigctl.runner.operators.automatic_operator import AutomaticOperator


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(shipped("rigs", "hl32-bench-lines.yaml"))


def carried_out(rig: Rig, backend: str, runs: Path, **options: object) -> tuple[ExitCode, str | None, Run]:
    plan = expand(load_procedure(shipped("procedures", "quick-check.yaml")), rig, {})
    how = Launch(
        runs=runs,
        operator=AutomaticOperator(),
        backend=backend,
        options={"seed": 3, **options},
        clock=clock_for("max", backend),
        exclusive=False,
        seed=3,
    )
    result = launch(plan, how)
    assert result.folder is not None
    return result.exit_code, result.reason, open_run(result.folder)


def test_the_quick_check_gives_the_same_strokes_as_the_simulated_bench(rig: Rig, tmp_path: Path) -> None:
    simulated = carried_out(rig, "simulated", tmp_path)
    emulated = carried_out(rig, "emulated", tmp_path)
    assert simulated[0] == emulated[0] == ExitCode.DONE, emulated[1]
    found = [[float(value) for value in run.records["stroke"]] for _, _, run in (emulated, simulated)]
    # here the computer switches the valve, to within a sampling period of 10 ms: 1.2 mm of stroke
    assert found[0] == pytest.approx(found[1], abs=2.5)
    info = emulated[2].info
    assert info["backend"]["firmware"].startswith("1.")


def test_a_trip_on_the_board_ends_the_run_with_its_message(rig: Rig, tmp_path: Path) -> None:
    code, reason, _ = carried_out(rig, "emulated", tmp_path, faults=["sensor_open:oil_temperature@4 s"])
    assert code == ExitCode.FAILED
    assert reason is not None
    assert "sensor open or shorted" in reason or "oil_temperature" in reason


def test_a_refusal_by_the_board_is_quoted(rig: Rig) -> None:
    clock = VirtualClock()
    bench = create(rig, clock, {"faults": ["sensor_open:oil_temperature@0.6 s"], "noise": "off"})
    assert isinstance(bench, LineBench)
    bench.open()
    clock.sleep_until(3.0)
    with pytest.raises(RigctlError, match="""the device answers '#1 !-221,"Settings conflict"'"""):
        bench.command("heater", 1.0).wait()
    bench.start(10.0)
    with pytest.raises(BackendLost, match=r"sensor open or shorted.* to 'SYST:TRIP"):
        for _ in range(30):
            bench.next_sample(0.5)
    bench.close()


def test_a_temporarily_silent_board_is_reconnected(rig: Rig) -> None:
    clock = VirtualClock()
    bench = create(rig, clock, {"faults": ["backend_lost@1.5 s..2.5 s"], "noise": "off"})
    bench.open()
    bench.start(20.0)
    times, notices = [], []
    while clock.now() < 6.0:
        sample = bench.next_sample(0.5)
        times += [sample.time] if sample is not None else []
        notices += bench.take_notices()
    assert [n.kind for n in notices if n.kind != "note"][:2] == ["fault", "gap"]
    assert times[-1] > 5.5
    assert not [time for time in times if 1.6 < time < 2.4]
    bench.close()
