"""One procedure, simulated and through the emulated board: the same records within noise."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.dataset import Run, open_run
from rigctl.errors import ExitCode
from rigctl.files.shipped import shipped
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig
from rigctl.runner.launch import Launch, clock_for, launch
from rigctl.runner.operator import AutomaticOperator


def carried_out(rig: Rig, backend: str, runs: Path, **options: object) -> tuple[ExitCode, str, Run]:
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


def strokes(run: Run) -> list[float]:
    return [float(value) for value in run.records["stroke"]]


def test_the_quick_check_gives_the_same_strokes(uno_rig: Rig, tmp_path: Path) -> None:
    simulated = carried_out(uno_rig, "simulated", tmp_path)
    emulated = carried_out(uno_rig, "emulated", tmp_path)
    assert simulated[0] == emulated[0] == ExitCode.DONE, emulated[1]
    # a stroke is the difference of two readings of 0.29 mm resolution, in mm, and 0.1 mm noise
    assert strokes(emulated[2]) == pytest.approx(strokes(simulated[2]), abs=0.9)


def test_a_trip_on_the_board_ends_the_run_and_is_named(uno_rig: Rig, tmp_path: Path) -> None:
    code, reason, run = carried_out(uno_rig, "emulated", tmp_path, faults=["sensor_open:oil_temperature@8 s"])
    assert code == ExitCode.FAILED
    assert "the board has tripped: sensor open or shorted" in reason
    alarms = run.events[run.events["kind"] == "alarm"]
    assert any("sensor open or shorted" in str(message) for message in alarms["message"])
