"""`rigctl calibrate`: from points or a bench to the rig file, without loss of its other content."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from rigctl.cli.main import app
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig
from systems import own_state
from tclab_board import Served

POINTS = "reference [bar],raw\n" + "".join(
    f"{bar},{round((bar + 12.5) / 0.1221896) + off}\n" for bar in (0, 20, 40, 60, 80) for off in (0, 1, -1)
)
Rigctl = Callable[..., Result]


@pytest.fixture
def rigctl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rigctl:
    """A command in a separate project with the Uno's rig file."""
    (tmp_path / "rigs").mkdir()
    shutil.copy(shipped("rigs", "hl32-bench-uno.yaml"), tmp_path / "rigs" / "bench.yaml")
    (tmp_path / "rigctl.toml").write_text('rig = "rigs/bench.yaml"\n', encoding="utf-8")
    (tmp_path / "points.csv").write_text(POINTS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rigctl.runner.rig_lock._state_folder", lambda: tmp_path / "locks")

    def call(*arguments: str, typed: str = "") -> Result:
        return CliRunner().invoke(app, ["calibrate", *arguments], input=typed, catch_exceptions=False)

    return call


def told(result: Result) -> dict[str, Any]:
    assert result.exit_code == 0, result.output
    answer: dict[str, Any] = json.loads(result.stdout)
    return answer


def test_points_become_a_dated_calibration_and_nothing_else_changes(rigctl: Rigctl, tmp_path: Path) -> None:
    path = tmp_path / "rigs" / "bench.yaml"
    before = path.read_bytes()
    answer = told(
        rigctl("supply_pressure", "--points", "points.csv", "--json", "--date", "2026-11-20",
               "--reference", "gauge \"7\", class 0.1", "--reference-uncertainty", "0.1 bar")
    )  # fmt: skip
    assert answer["written"]
    assert answer["coefficients"] == pytest.approx([-12.5, 0.1221896], rel=1e-2)
    rig = load_rig(path)
    calibration = rig.channels["supply_pressure"].calibration
    assert calibration.coefficients == pytest.approx(answer["coefficients"], rel=1e-9)
    assert (calibration.date, calibration.reference) == (date(2026, 11, 20), 'gauge "7", class 0.1')
    assert calibration.kind == "line"
    assert calibration.uncertainty is not None
    assert float(calibration.uncertainty) == pytest.approx(answer["uncertainty"] * 1e5, rel=0.01)
    assert calibration.valid_for == 365 * 86400.0  # as it was

    now = path.read_bytes()
    assert Path(answer["backup"]).read_bytes() == before
    old, new = before.decode().splitlines(), now.decode().splitlines()
    added = [line for line in new if line.strip() == "kind: line"]
    assert len(added) == 1
    new.remove(added[0])
    different = [(a, b) for a, b in zip(old, new, strict=True) if a != b]
    assert len(different) == 4  # coefficients, date, reference, uncertainty
    assert different[0][1].endswith("# 0.5 V is 0 bar, 4.5 V is 100 bar")  # the user's comment


def test_figure_and_points_are_kept_beside_the_rig_file(rigctl: Rigctl, tmp_path: Path) -> None:
    answer = told(rigctl("supply_pressure", "--points", "points.csv", "--json"))
    assert Path(answer["figure"]).read_bytes().startswith(b"\x89PNG")
    again = told(rigctl("supply_pressure", "--points", answer["points_file"], "--json", "--dry"))
    assert again["coefficients"] == pytest.approx(answer["coefficients"])
    assert not again["written"]
    folder = tmp_path / "rigs" / "calibrations"
    assert {file.suffix for file in folder.iterdir()} == {".yaml", ".csv", ".png"}
    # a second calibration removes no file
    told(rigctl("supply_pressure", "--points", "points.csv", "--json"))
    assert len(list(folder.glob("*.yaml"))) == 2


def test_the_terminal_shows_residuals_polynomial_and_uncertainty(rigctl: Rigctl) -> None:
    shown = rigctl("supply_pressure", "--points", "points.csv", "--dry")
    assert shown.exit_code == 0
    assert "residual [bar]" in shown.stdout
    assert shown.stdout.count("●") == 5
    assert "supply_pressure [bar] = -12.4" in shown.stdout
    assert "uncertainty 0." in shown.stdout
    assert "nothing written" in shown.stdout


def test_two_points_are_fitted_with_a_warning(rigctl: Rigctl, tmp_path: Path) -> None:
    (tmp_path / "two.csv").write_text("reference [kPa],raw\n0,102\n2000,266\n", encoding="utf-8")
    answer = told(rigctl("supply_pressure", "--points", "two.csv", "--json", "--dry"))
    assert answer["residual_std"] is None
    assert [point["reference"] for point in answer["points"]] == pytest.approx([0.0, 20.0])
    assert any("take more" in remark for remark in answer["remarks"])
    assert any("extrapolated" in remark for remark in answer["remarks"])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("", "the file is empty"),
        ("ref,raw\n1,2\n", "one column 'reference' is expected"),
        ("reference [mm],raw\n1,2\n", "wrong dimension"),
        ("reference,raw\n1,2\nx,3\n", r"bad.csv:3: no number, got 'x'"),
        ("reference,raw\n1,2\n1\n", r"bad.csv:3: no number"),
        ("reference,raw\n1,nan\n", "no number"),
        ("reference,raw\n1,2\n", "too few points"),
    ],
)
def test_an_invalid_table_of_points_is_refused_and_the_rig_file_unchanged(
    rigctl: Rigctl, tmp_path: Path, table: str, message: str
) -> None:
    (tmp_path / "bad.csv").write_text(table, encoding="utf-8")
    before = (tmp_path / "rigs" / "bench.yaml").read_bytes()
    with pytest.raises(RigctlError, match=message):
        rigctl("supply_pressure", "--points", "bad.csv")
    assert (tmp_path / "rigs" / "bench.yaml").read_bytes() == before


def test_mistakes_on_the_command_line_are_reported(rigctl: Rigctl) -> None:
    with pytest.raises(RigctlError, match="did you mean 'supply_pressure'"):
        rigctl("suply_pressure", "--points", "points.csv")
    with pytest.raises(RigctlError, match="--date: no date"):
        rigctl("supply_pressure", "--points", "points.csv", "--date", "tomorrow")
    with pytest.raises(RigctlError, match="wrong dimension"):
        rigctl("supply_pressure", "--points", "points.csv", "--reference-uncertainty", "1 K")
    with pytest.raises(RigctlError, match="--reference-uncertainty: too small"):
        rigctl("supply_pressure", "--points", "points.csv", "--reference-uncertainty=-1 bar")
    with pytest.raises(RigctlError, match="there is no such file"):
        rigctl("supply_pressure", "--points", "nothing.csv")


def test_a_calibration_that_others_share_is_not_changed(rigctl: Rigctl, tmp_path: Path) -> None:
    path = tmp_path / "rigs" / "bench.yaml"
    text = path.read_text(encoding="utf-8")
    text = text.replace("      coefficients: [-12.5, 0.1221896]", "      coefficients: &c [-12.5, 0.1221896]")
    text = text.replace("coefficients: [-10.0, 0.29325513]", "coefficients: *c")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RigctlError, match="shared with another part of the file"):
        rigctl("supply_pressure", "--points", "points.csv")
    assert path.read_text(encoding="utf-8") == text


def test_a_rig_file_changed_meanwhile_is_not_overwritten(rigctl: Rigctl, tmp_path: Path) -> None:
    from rigctl.rig.calibration_file import write_calibration

    path = tmp_path / "rigs" / "bench.yaml"
    rig = load_rig(path)
    path.write_text(rig.text + "# an editor was faster\n", encoding="utf-8")
    with pytest.raises(RigctlError, match="changed meanwhile"):
        write_calibration(rig, rig.text, datetime.now(UTC))
    assert path.read_text(encoding="utf-8").endswith("faster\n")


def test_calibration_points_can_come_from_a_run_that_prompted_for_the_reference(
    rigctl: Rigctl, tmp_path: Path
) -> None:
    """The operator enters readings of a gauge that reads 2 % more than the transducer."""
    text = shipped("procedures", "calibrate-pressure.yaml").read_text(encoding="utf-8")
    text = text.replace("rigs/hl32-bench.yaml", "rigs/bench.yaml").replace(
        "simulated: $gauge", "simulated: 1.02 * $gauge"
    )
    (tmp_path / "gauge.yaml").write_text(text, encoding="utf-8")
    arguments = ["--backend", "simulated", "--speed", "max", "--arg", "tolerance=2 bar"]
    done = CliRunner().invoke(app, ["run", "gauge.yaml", *arguments])
    assert done.exit_code == 0, done.output
    answer = told(
        rigctl("supply_pressure", "--run", "latest", "--against", "reference_pressure", "--json", "--dry")
    )
    assert [point["reference"] for point in answer["points"]] == pytest.approx([10.2, 20.4, 30.6, 40.8, 51.0])
    assert answer["coefficients"][1] == pytest.approx(1.02 * 0.1221896, rel=0.005)
    with pytest.raises(RigctlError, match="did you mean 'reference_pressure'"):
        rigctl("supply_pressure", "--run", "latest", "--against", "reference_presure")
    with pytest.raises(RigctlError, match="which value"):
        rigctl("supply_pressure", "--run", "latest")
    with pytest.raises(RigctlError, match="points come from one source"):
        rigctl("supply_pressure", "--run", "latest", "--points", "points.csv")


def test_guided_calibration_takes_its_answers_from_stdin(rigctl: Rigctl) -> None:
    with pytest.raises(RigctlError, match="too few points with different raw values, got '1'"):
        rigctl("position", "--backend", "simulated", "--speed", "max", "--readings", "5", "--dry",
               typed="0 mm\n5\nnonsense\n3 bar\nundo\n\n")  # fmt: skip


def test_guided_calibration_reads_the_board_at_each_reference_value(tmp_path: Path) -> None:
    """The two-heater board: its thermometer reads 1 % and 2 K too much, which the calibration finds."""
    shutil.copy(shipped("rigs", "tclab-board.yaml"), tmp_path / "board.yaml")
    (tmp_path / "rigctl.toml").write_text('rig = "board.yaml"\n', encoding="utf-8")
    environment = {**os.environ, **own_state(tmp_path / "state"), "PYTHONUNBUFFERED": "1"}
    with Served() as board:
        options = ["--json", "--readings", "4", "--rate", "10", "--reference", "mercury"]
        command = [
            sys.executable,
            "-m",
            "rigctl",
            "calibrate",
            "temperature_1",
            "--port",
            board.url,
            *options,
        ]
        pipe = subprocess.PIPE
        with subprocess.Popen(
            command, cwd=tmp_path, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=environment
        ) as run:
            assert run.stdin is not None
            assert run.stderr is not None
            assert run.stdout is not None
            for number, true in enumerate((20.0, 40.0, 60.0), start=1):
                board.sketch.model._T1 = board.sketch.model._H1 = 2.0 + 1.01 * true
                run.stdin.write(f"{true} degC\n")
                run.stdin.flush()
                while f"point {number}:" not in (line := run.stderr.readline()):
                    assert line, "it has ended"
            run.stdin.close()
            answer = json.loads(run.stdout.read())
    assert answer["coefficients"] == pytest.approx([-2.0 / 1.01, 1.0 / 1.01], rel=0.2)
    assert [point["readings"] for point in answer["points"]] == [4, 4, 4]
    calibration = load_rig(tmp_path / "board.yaml").channels["temperature_1"].calibration
    assert calibration.reference == "mercury"
    assert board.sketch.heaters == (0.0, 0.0)


def test_an_old_calibration_is_warned_of(rigctl: Rigctl, tmp_path: Path) -> None:
    told(
        rigctl(
            "supply_pressure",
            "--points",
            "points.csv",
            "--json",
            "--date",
            "2025-01-01",
            "--valid-for",
            "30 day",
        )
    )
    (tmp_path / "p.yaml").write_text(
        "procedure: p\nrig: rigs/bench.yaml\nsteps: [wait: 1 s]\n", encoding="utf-8"
    )
    checked = CliRunner().invoke(app, ["check", "p.yaml", "--json"])
    assert "channel 'supply_pressure': its calibration of 2025-01-01 ran out on 2025-01-31" in checked.stdout
    run = CliRunner().invoke(app, ["run", "p.yaml", "--backend", "simulated", "--speed", "max"])
    assert "its calibration of 2025-01-01 ran out" in run.stderr
