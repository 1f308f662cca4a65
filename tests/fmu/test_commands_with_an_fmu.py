"""Commands besides compare and diagnose with an FMU as the model: the motor in C."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from commands import answer, told
from fmu.motor_bench import write_bench
from rigctl.cli.main import app
from rigctl.dataset import open_run
from rigctl.fmu.archive import digest
from rigctl.fmu.program import allow
from rigctl.workbench import Workbench
from systems import needs_compiler

pytestmark = needs_compiler

MODEL = ("--model", "model.yaml", "--family", "motor.fmu")


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_the_page_of_a_report_compares_it(tmp_path: Path) -> None:
    run = write_bench(tmp_path)
    told("report", run, *MODEL, "-o", "page.html")
    page = Path("page.html").read_text("utf-8")
    assert "agrees with the measurements within their noise" in page


def test_an_effect_at_its_edge_is_applied(tmp_path: Path) -> None:
    run = write_bench(tmp_path, reading=lambda speed: speed + 4.0)
    told("diagnose", run, *MODEL, "--max-effects", "1", "--apply")
    effects = answer("model", "show", "model.yaml", "--family", "motor.fmu")["effects"]
    assert [one["effect"] for one in effects] == ["offset_of_speed"]


def test_a_survey_of_one_run_reads_its_parameters(tmp_path: Path) -> None:
    run = write_bench(tmp_path)
    found = answer("survey", run, *MODEL, "--by", "record", "--effects", "none", "--workers", "1")
    assert len(found["runs"]) == 5


def test_sliders_move_it(tmp_path: Path) -> None:
    run = write_bench(tmp_path)
    allow(digest(Path("motor.fmu")))
    bench = Workbench.open([open_run(run)], Path("model.yaml"), named="model.yaml")
    before = bench.exact.outputs[0]
    moved = bench.follow(bench.start.moved({"resistance": 4.0}))
    assert np.abs(moved.outputs[0] - before).max() > 0.1


def test_importing_a_log_says_how_to_compare_it(tmp_path: Path) -> None:
    write_bench(tmp_path)
    told("family", "new", "drive", "--fmu", "motor.fmu", "--csv", "log.csv")
    done = CliRunner().invoke(app, ["import", "log.csv", "--rig", "rigs/drive.yaml"])
    assert "Next: rigctl compare latest --model models/drive.yaml --family motor.fmu" in done.stderr


def test_a_design_simulates_it_and_leaves_out_a_sensor_that_it_does_not_have(tmp_path: Path) -> None:
    run = write_bench(tmp_path)
    rig = Path("rig.yaml").read_text("utf-8")
    possible = "could_have:\n  winding: {unit: degC, quantity: temperature, noise: 0.1 K, price: 90 EUR}\n"
    possible += (
        "  tachometer: {unit: rad/s, quantity: other, noise: 0.1 rad/s, reads: speed, price: 70 EUR}\n"
    )
    Path("rig.yaml").write_text(rig + possible, encoding="utf-8")
    separate = ("--separate", "drift_of_damping_with_voltage,drift_of_kt_with_voltage")
    found = answer("design", run, *MODEL, *separate, "--sensors", "--records", "1", "-o", "next.yaml")
    assert found["records"], found["statement"]
    assert found["probability"] > found["probability_before"] + 0.2
    assert {name for one in found["sensors"] for name in one["channels"]} == {"tachometer"}
    (note,) = (one for one in found["notes"] if one.startswith("winding was not evaluated: "))
    assert "unknown quantity of the model that the sensor 'winding' could read" in note
    told("check", "next.yaml", "--rig", "rig.yaml")


def test_a_rig_of_another_family_has_options_that_it_does_not_know(tmp_path: Path) -> None:
    """The shipped bench says where its throttle sits; an FMU of it has that inside."""
    run = write_bench(tmp_path)
    rig = Path("rig.yaml").read_text("utf-8")
    Path("rig.yaml").write_text(f"{rig}options: {{throttle: meter_in}}\n", encoding="utf-8")
    assert answer("compare", run, *MODEL)["models"][0]["adequate"]
