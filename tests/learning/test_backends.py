"""Learning on a line-based board and on the emulated one: interrupted, killed and resumed."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

import own_process
from commands import answer, refusal
from patience import patient
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run
from rigctl.dataset.run_json import read_info
from rigctl.files.shipped import shipped
from systems import needs_signals
from tclab_board import Served

ONE_ROUND = ("--max-rounds", "1", "--json")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with the shipped models on the rigs that are used here."""
    folder = tmp_path_factory.mktemp("backends")
    create_project(folder)
    for name, rig in (("heater-board", "tclab-board"), ("hl32-textbook", "hl32-bench-uno")):
        text = (folder / "models" / f"{name}.yaml").read_text("utf-8")
        own = text.replace(f"rigs/{name.replace('hl32-textbook', 'hl32-bench')}.yaml", f"rigs/{rig}.yaml")
        assert own != text
        (folder / "models" / f"{rig}.yaml").write_text(own, encoding="utf-8")
    text = shipped("rigs", "tclab-board.yaml").read_text(encoding="utf-8")
    (folder / "rigs" / "tclab-board.yaml").write_text(patient(text), encoding="utf-8")
    return folder


def ended(process: subprocess.Popen[str]) -> dict[str, Any]:
    printed, said = process.communicate(timeout=600)
    assert printed, said
    found: dict[str, Any] = json.loads(printed)
    return found


def only_run(folder: Path) -> Path:
    (found,) = (folder / "runs").glob("*/run.json")
    return found.parent


@pytest.mark.parametrize("seed", ["0", "1"])
def test_a_seed_is_refused_where_it_would_have_no_effect(bench: Path, seed: str) -> None:
    with chdir(bench):
        model = ("--model", "models/tclab-board.yaml")
        said = refusal("learn", "procedures/tclab-step.yaml", *model, "--seed", seed)
    assert f"the serial backend takes no --seed, got '{seed}'" in said


@needs_signals
def test_an_interrupted_round_on_a_line_device_ends_safely_and_resumes(bench: Path) -> None:
    model = ("--model", "models/tclab-board.yaml")
    with Served() as board:
        times = ("-a", "rest=5 s", "-a", "dwell=5 s", "--port", board.url)
        first = own_process.begin(bench, "learn", "procedures/tclab-step.yaml", *model, *times, *ONE_ROUND)
        while board.sketch.heaters == (0.0, 0.0):
            time.sleep(0.02)
            assert first.poll() is None, first.communicate()
        first.send_signal(signal.SIGINT)
        stopped = ended(first)
        assert board.sketch.heaters == (0.0, 0.0)
        assert (stopped["ended"], first.returncode) == ("stopped", 130)
        assert stopped["rounds"][0]["run"] is None

        again = own_process.begin(bench, "learn", "--resume", "--json")
        learned = ended(again)
        assert board.sketch.heaters == (0.0, 0.0)
    assert again.returncode == 0
    (judged,) = learned["rounds"]
    assert judged["verdict"]
    run = only_run(bench)
    assert judged["run"] == run.name
    info = read_info(run)
    assert (info["backend"]["kind"], info["status"], len(info["sessions"])) == ("serial", "finished", 2)


@pytest.mark.skipif(sys.platform != "linux", reason="simavr is packaged for Linux only")
def test_a_round_runs_on_the_emulated_board(bench: Path) -> None:
    with chdir(bench):
        learned = answer(
            *("learn", "procedures/stroke.yaml", "--rig", "rigs/hl32-bench-uno.yaml"),
            *("--model", "models/hl32-bench-uno.yaml", "--backend", "emulated", "--speed", "max"),
            *ONE_ROUND[:2],
        )
        (judged,) = learned["rounds"]
        run = open_run(judged["run"])
    assert judged["verdict"]
    assert set(judged["error"]) == {"oil_temperature", "supply_pressure", "position"}
    assert run.info["backend"]["kind"] == "emulated"
    assert len(run.records) == 1


def test_a_round_whose_process_is_killed_is_not_measured_twice(tmp_path: Path) -> None:
    create_project(tmp_path)
    steps = ("procedures/heater-board-steps.yaml", "-a", "powers=30 %", "-a", "rest=2 s", "-a", "dwell=4 s")
    begun = ("learn", *steps, "--model", "models/heater-board.yaml", "--speed", "2x")
    first = own_process.begin(tmp_path, *begun, *ONE_ROUND)
    while not any(b'"kind":"record"' in one.read_bytes() for one in (tmp_path / "runs").glob("*/log.jsonl")):
        time.sleep(0.02)
        assert first.poll() is None, first.communicate()
    first.kill()
    first.communicate()
    learned = ended(own_process.begin(tmp_path, "learn", "--resume", "--yes", "--json"))
    (judged,) = learned["rounds"]
    run = only_run(tmp_path)
    assert judged["run"] == run.name
    assert (read_info(run)["status"], len(read_info(run)["sessions"])) == ("finished", 2)
    assert judged["verdict"]
