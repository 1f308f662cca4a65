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
