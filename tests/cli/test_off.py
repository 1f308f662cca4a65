"""`rigctl off`, the emergency switch: it ends runs, reads outputs back, and works despite damage."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest

from own_process import begin, rigctl
from patience import patient
from rigctl.files.shipped import shipped
from tclab_board import Served
from torture import switching_off


def test_off_ends_a_simulation_in_progress(tmp_path: Path) -> None:
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    steps = "procedure: p\nrig: rigs/heater-board.yaml\nsteps:\n  - set: {heater_1: 60 %}\n  - wait: 1 h\n"
    (tmp_path / "p.yaml").write_text(steps, encoding="utf-8")
    run = begin(tmp_path, "simulate", "p.yaml", "--speed", "1x", "--json")
    try:
        while not any('"running"' in p.read_text() for p in (tmp_path / "runs").glob("2*/state.json")):
            time.sleep(0.05)
            assert run.poll() is None, run.communicate()
        code, out, err = rigctl(
            tmp_path, "off", "--rig", "rigs/heater-board.yaml", "--backend", "simulated", "--json"
        )
        assert code == 0, err
        told = json.loads(out)
        (ended,) = told["ended"]
        assert "ending: outputs are safe first" in ended
        assert "no real one was touched" in told["known_by"]
        answer = json.loads(run.communicate(timeout=600)[0])
        assert (answer["status"], answer["exit_code"]) == ("aborted", 130)
    finally:
        run.kill()
        run.communicate()


def test_off_with_only_a_port_identifies_the_device(tmp_path: Path) -> None:
    with Served() as board:
        board.sketch.model._Q1 = 60
        code, out, err = rigctl(tmp_path, "off", "--port", board.url, "--json")
        assert code == 0, err
        told = json.loads(out)
        assert (told["confirmed"], told["known_by"]) == (True, "read back from the bench")
        assert board.sketch.heaters == (0.0, 0.0)
        board.sketch.always["R1"] = b"60.00\r\n"  # whatever is commanded
        code, out, err = rigctl(tmp_path, "off", "--port", board.url)
        assert code == 1
        assert "60 %" in err
        assert "rigctl off" not in err


def test_off_ends_a_run_which_confirms_that_it_is_safe(tmp_path: Path) -> None:
    done = switching_off.running_run(tmp_path / "project")
    assert done.told["known_by"] == "the run that has the bench has made it safe"


@pytest.mark.skipif(sys.platform != "linux", reason="simavr is packaged for Linux only")
def test_rigctls_own_board_is_recognised_from_its_port_alone(tmp_path: Path) -> None:
    switching_off.board_with_only_a_port(tmp_path / "nowhere")


def test_manual_action_is_suggested_before_a_dead_line_times_out(tmp_path: Path) -> None:
    switching_off.dead_line(tmp_path / "project")


@pytest.mark.parametrize("content", ["", "{", "[]", '{"pid": "x"}', '{"token": 1, "beat": null}', "TYPES"])
def test_a_corrupt_lock_does_not_prevent_off(tmp_path: Path, content: str) -> None:
    from rigctl.runner.rig_lock import RigLock, read_owner

    path = tmp_path / "bench.json"
    if content == "TYPES":
        fields = {"token": "t", "rig": "r", "purpose": "p", "host": "h", "pid": 1, "beat": "x", "date": []}
        content = json.dumps(fields)
    path.write_text(content, encoding="utf-8")
    assert read_owner(path) is None
    assert RigLock("bench", "a test", tmp_path).owner() is None
    with RigLock("bench", "a test", tmp_path):
        assert read_owner(path) is not None


@pytest.mark.parametrize(
    ("reported", "answers", "confirmed", "known_by"),
    [
        (True, False, True, "read back from the bench"),
        (False, True, True, "the bench has answered each command"),
        (False, False, False, "sent, not confirmed: heater_1, heater_2; see for yourself whether it is off"),
    ],
)
def test_only_an_answer_of_the_device_confirms_that_outputs_are_off(
    tmp_path: Path, reported: bool, answers: bool, confirmed: bool, known_by: str
) -> None:
    text = shipped("rigs", "tclab-board.yaml").read_text(encoding="utf-8")
    for heater in ("1", "2"):
        if not reported:
            query = f'      - {{send: R{heater}, reply: "{{heater_{heater}}}", every: 1 s}}\n'
            assert query in text
            text = text.replace(query, "")
        if not answers:
            setting = f'heater_{heater}: {{send: "Q{heater} {{value:.2f}}", reply: "{{value}}"}}'
            assert setting in text
            text = text.replace(setting, f'heater_{heater}: {{send: "Q{heater} {{value:.2f}}"}}')
    (tmp_path / "board.yaml").write_text(patient(text), encoding="utf-8")
    with Served() as board:
        for heater in ("1", "2"):
            if not answers:
                board.sketch.always[f"Q{heater} 0.00"] = b""
        code, out, err = rigctl(tmp_path, "off", "--rig", "board.yaml", "--port", board.url, "--json")
    told = json.loads(out)
    assert (told["confirmed"], told["known_by"]) == (confirmed, known_by), err
    assert code == (0 if confirmed else 1)
    assert ("outputs are safe" in told["done"]) is confirmed
