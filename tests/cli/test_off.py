"""`rigctl off`, the emergency switch: it ends runs, reads outputs back, and works despite damage."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest

from commands import refusal
from own_process import begin, rigctl
from patience import patient
from rigctl.backends.errors import BackendLost
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig, parse_rig
from rigctl.runner import switch_off as off
from rigctl.runner.bench_access import Access, addresses_in
from rigctl.runner.rig_lock import RigLock
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


def test_a_run_of_another_rig_that_has_one_of_the_devices_does_not_speak_for_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has made its own device safe; whether the others are is not known if they are not reached."""
    rig = load_rig(shipped("rigs", "oil-circuit-devices.yaml"))
    ports = {"controller": "10.0.0.1:502", "plant": "opc.tcp://10.0.0.2:4840", "meter": "10.0.0.3:5025"}
    how = Access(runs=tmp_path / "runs", options={"port": ports}, lock_folder=tmp_path / "locks")

    def unreachable(*_: object) -> tuple[str, bool, str]:
        raise BackendLost("meter: no answer")

    monkeypatch.setattr(off, "_switch_off_here", unreachable)
    monkeypatch.setattr(off, "send", lambda *_, **__: "ending: outputs are safe first")
    monkeypatch.setattr(off, "_made_safe", lambda _: True)
    key = addresses_in(rig, how)["controller"].key
    for name in ("another rig", rig.name):
        with RigLock(name, "a run", tmp_path / "locks", key=key) as lock:
            lock.take_for(tmp_path / "run")
            if name == rig.name:  # it was given other ports for the rest
                assert off.switch_off(rig, how).known_by == "the run that has the bench has made it safe"
            else:
                with pytest.raises(BackendLost, match="meter: no answer"):
                    off.switch_off(rig, how)


def test_off_says_of_devices_that_are_all_simulated_that_none_is_real(tmp_path: Path) -> None:
    part = "{unit: V, quantity: voltage, device: "
    text = "name: two\ndevices: {a: {kind: simulated}, b: {kind: simulated}}\n"
    text += f"channels: {{va: {part}a}}, vb: {part}b}}}}\nactuators: {{x: {{device: a, kind: switch}}}}\n"
    rig = parse_rig(text + "safe_state: {x: off}\n")
    done = off.switch_off(rig, Access(runs=tmp_path / "runs", lock_folder=tmp_path / "locks"))
    assert "no real one was touched" in done.known_by


def test_a_bench_of_one_device_is_not_one_of_several(tmp_path: Path) -> None:
    rig = shipped("rigs", "tclab-board.yaml")
    said = refusal("off", "--rig", str(rig), "--backend", "devices", "--port", "/dev/ttyUSB0")
    assert "has one backend, got 'devices'" in said


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
