"""`rigctl run` on a line-based device: the two-heater board, with its protocol on a TCP port."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import own_process
from patience import patient
from rigctl.dataset import open_run
from rigctl.files.shipped import shipped
from systems import own_state
from tclab_board import Served

#: longer than a busy computer stalls, so that each part has samples
SHORT = ("--arg", "rest=5 s", "--arg", "dwell=5 s")


@pytest.fixture
def board() -> Iterator[Served]:
    with Served() as served:
        yield served


def patient_project(folder: Path) -> None:
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    (folder / "rigs").mkdir()
    text = shipped("rigs", "tclab-board.yaml").read_text(encoding="utf-8")
    (folder / "rigs" / "tclab-board.yaml").write_text(patient(text), encoding="utf-8")


def begin(folder: Path, board: Served, *more: str) -> subprocess.Popen[str]:
    patient_project(folder)
    run = (
        "run",
        "procedures/tclab-step.yaml",
        "--rig",
        "rigs/tclab-board.yaml",
        "--port",
        board.url,
        "--json",
    )
    return own_process.begin(folder, *run, *more)


def ended(run: subprocess.Popen[str]) -> dict[str, Any]:
    printed, told = run.communicate(timeout=600)
    assert printed, told
    answer: dict[str, Any] = json.loads(printed)
    return answer


def test_a_step_test_runs_on_the_board_and_records_its_steps(board: Served, tmp_path: Path) -> None:
    answer = ended(begin(tmp_path, board, *SHORT, "--arg", "heater=2", "--arg", "power=30 %"))
    assert (answer["status"], answer["records"], answer["exit_code"]) == ("finished", 2, 0)
    run = open_run(Path(answer["path"]))
    assert run.info["backend"]["firmware"] == "1.4.0 Arduino Uno"
    up = run.samples(record=0)
    assert float(up["heater_2"].iloc[0]) == 0.0
    assert float(up["heater_2"].iloc[-1]) == 30.0
    assert up["time"].diff().dropna().median() == pytest.approx(0.5, abs=0.05)
    assert "Q2 30.00" in board.sketch.received
    assert board.sketch.received[-6:] == ["X", "Q1 0.00", "Q2 0.00", "R1", "R2", "VER"]
    assert board.sketch.heaters == (0.0, 0.0)


def test_over_temperature_is_detected_and_switches_off(board: Served, tmp_path: Path) -> None:
    run = begin(tmp_path, board, "--arg", "rest=5 s")
    while board.sketch.heaters == (0.0, 0.0):
        time.sleep(0.01)
        assert run.poll() is None, run.communicate()
    board.sketch.model._T1 = board.sketch.model._H1 = 110.0
    while board.sketch.heaters != (0.0, 0.0):
        time.sleep(0.01)
        assert run.poll() is None, "it ended, and a heater is on"
    answer = ended(run)
    assert answer["exit_code"] == 1
    assert "Heater 1 over-temperature" in answer["reason"] or ("cannot warm up this fast" in answer["reason"])


def test_a_wrong_board_is_reported(board: Served, tmp_path: Path) -> None:
    board.sketch.always["VER"] = b"ACME toaster 3\r\n"
    answer = ended(begin(tmp_path, board, *SHORT))
    assert answer["exit_code"] == 1
    assert "got 'ACME toaster 3'; expected TCLab Firmware {firmware}" in answer["error"]["message"]


def test_monitor_quotes_a_reply_that_does_not_match(board: Served, tmp_path: Path) -> None:
    """Only "missing" was shown, and the pattern in the rig file had to be found wrong by other means."""
    board.sketch.always["T1"] = b"ACME 21\r\n"
    patient_project(tmp_path)
    words = ("monitor", "--rig", "rigs/tclab-board.yaml", "--port", board.url, "--count", "2")
    shown, told = own_process.begin(tmp_path, *words).communicate(timeout=600)
    assert "temperature_1 missing" in shown
    assert told.count("the device answers 'ACME 21' to 'T1'; expected") == 1


def test_off_works_without_a_run(board: Served, tmp_path: Path) -> None:
    board.sketch.model._Q1 = 60
    patient_project(tmp_path)
    command = [sys.executable, "-m", "rigctl", "off", "--rig", "rigs/tclab-board.yaml", "--port", board.url]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**os.environ, **own_state(tmp_path / "state")},
        check=True,
    )
    assert "heater_1 0 %" in done.stdout
    assert board.sketch.heaters == (0.0, 0.0)


def test_a_record_too_fast_for_the_device_is_refused_before_the_run_starts(tmp_path: Path) -> None:
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    text = (
        "procedure: p\nrig: rigs/tclab-board.yaml\nsteps:\n  - record: {name: r, rate: 50 Hz}\n    do: []\n"
    )
    (tmp_path / "fast.yaml").write_text(text.replace("[]", "[wait: 1 s]"), encoding="utf-8")
    calls = (("check", "fast.yaml"), ("simulate", "fast.yaml"), ("run", "fast.yaml", "--port", "/dev/nobody"))
    checked, simulated, refused = (
        subprocess.run(
            [sys.executable, "-m", "rigctl", *call],
            check=False,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            env={**os.environ, **own_state(tmp_path / "state")},
        )
        for call in calls
    )
    message = "50 Hz is more than the device can be asked for: 10 Hz"
    assert checked.returncode == 2
    assert message in checked.stderr
    assert simulated.returncode == 0
    assert refused.returncode == 2
    assert "fast.yaml:4:" in refused.stderr
    assert message in refused.stderr
