"""A device without a watchdog and with a dead line at the end: it is reported, and its guard keeps trying.

Real processes on the stand-in of the two-heater board, whose heaters show what was switched.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from own_process import begin, rigctl
from patience import patient
from rigctl.backends.transport.safe_state_retries import Notice
from rigctl.files.shipped import shipped
from tclab_board import Served, Sketch

SWITCHING = """\
procedure: heating
rig: board.yaml
steps:
  - set: {heater_1: 60 %}
  - wait: 2 s
  - set: {heater_1: 0 %}
"""
HEATING = """\
procedure: heating
rig: board.yaml
steps:
  - set: {heater_1: 60 %}
  - wait: 1 h
"""


@pytest.fixture
def board() -> Iterator[Served]:
    with Served() as served:
        yield served


@pytest.fixture
def project(tmp_path: Path) -> Iterator[Path]:
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    text = shipped("rigs", "tclab-board.yaml").read_text(encoding="utf-8")
    limited = patient(text, wake="5 s", stale_after="8 s")
    (tmp_path / "board.yaml").write_text(limited, encoding="utf-8")
    (tmp_path / "heating.yaml").write_text(HEATING, encoding="utf-8")
    yield tmp_path
    for _ in range(100):  # a second guard may just be about to find the device safe
        for notice in (tmp_path / "state" / "rigctl" / "guards").glob("*.json"):
            notice.unlink(missing_ok=True)
        time.sleep(0.01)


def wait_for(condition: Callable[[], object]) -> None:
    give_up = time.monotonic() + 600.0
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.01)


def after(lines: list[str], line: str) -> list[str]:
    """The output after a line; empty where the line has not come yet."""
    return lines[lines.index(line) + 1 :] if line in lines else []


def guards(project: Path) -> list[Notice]:
    files = (project / "state" / "rigctl" / "guards").glob("*.json")
    return [Notice(**json.loads(path.read_text(encoding="utf-8"))) for path in files]


def lie(board: Served) -> None:
    """From now on 'off' is acknowledged, and not carried out."""
    board.sketch.always |= {"X": b"X\r\n", "Q1 0.00": b"0.00\r\n"}


@pytest.mark.parametrize("how", ["mute", "unplugged"])
def test_a_dead_line_at_the_end_is_reported_and_the_guard_continues(
    board: Served, project: Path, how: str
) -> None:
    run = begin(project, "run", "heating.yaml", "--port", board.url, "--json")
    wait_for(lambda: "R1" in after(board.sketch.received, "Q1 60.00"))  # it reads back that the heater is on
    setattr(board, how, True)
    out, err = run.communicate(timeout=600)
    answer = json.loads(out)
    assert (run.returncode, answer["exit_code"], answer["status"]) == (1, 1, "failed")
    assert answer["unconfirmed"] == "heater_1 60 %"
    assert "by hand" in answer["by_hand"]
    assert "guard goes on trying" in answer["by_hand"]
    assert "OUTPUTS NOT CONFIRMED SAFE: heater_1 60 % may still be on" in answer["reason"]
    assert "OUTPUTS NOT CONFIRMED SAFE" in err
    kept = json.loads((Path(answer["path"]) / "run.json").read_text(encoding="utf-8"))
    assert kept["unconfirmed"] == "heater_1 60 %"
    log = (Path(answer["path"]) / "log.jsonl").read_text(encoding="utf-8").splitlines()
    given = [
        e["value"] for e in map(json.loads, log) if e["kind"] == "command" and e["actuator"] == "heater_1"
    ]
    assert given[-1] == 0.6, "what never arrived is not logged as given"
    assert board.sketch.heaters == (60.0, 0.0), "the witness: it is on"

    wait_for(lambda: [guard for guard in guards(project) if guard.attempts > 1])
    code, told, _ = rigctl(project, "doctor", "--json")
    (finding,) = [f for f in json.loads(told)["findings"] if f["subject"] == "OUTPUTS MAY BE ON"]
    assert code == 1
    assert board.url in finding["detail"]

    setattr(board, how, False)
    wait_for(lambda: board.sketch.heaters == (0.0, 0.0))
    wait_for(lambda: guards(project) == [])


def test_the_guard_of_a_killed_host_switches_off_when_the_line_returns(board: Served, project: Path) -> None:
    with begin(project, "run", "heating.yaml", "--port", board.url) as run:
        wait_for(lambda: board.sketch.heaters == (60.0, 0.0))
        board.unplugged = True
        time.sleep(0.5)
        run.kill()
    wait_for(lambda: guards(project))
    assert board.sketch.heaters == (60.0, 0.0)
    board.unplugged = False
    wait_for(lambda: board.sketch.heaters == (0.0, 0.0))
    wait_for(lambda: guards(project) == [])


def test_off_takes_over_from_a_trying_guard(board: Served, project: Path) -> None:
    with begin(project, "run", "heating.yaml", "--port", board.url) as run:
        wait_for(lambda: board.sketch.heaters == (60.0, 0.0))
        board.mute = True
        run.kill()
    wait_for(lambda: guards(project))
    code, _, err = rigctl(project, "off", "--rig", "board.yaml", "--port", board.url)
    assert code == 1
    assert "cannot be reached" in err or "nobody answers" in err
    wait_for(lambda: guards(project))  # a command that could not make it safe leaves this to a guard
    board.mute = False
    wait_for(lambda: board.sketch.heaters == (0.0, 0.0))
    wait_for(lambda: guards(project) == [])
    code, out, _ = rigctl(project, "off", "--rig", "board.yaml", "--port", board.url)
    assert (code, "heater_1 0 %" in out) == (0, True)


def test_a_device_with_a_different_answer_is_not_considered_safe(board: Served, project: Path) -> None:
    with begin(project, "run", "heating.yaml", "--port", board.url) as run:
        wait_for(lambda: board.sketch.heaters == (60.0, 0.0))
        board.sketch.always["Q1 0.00"] = b"60.00\r\n"
        run.kill()
    wait_for(lambda: any("'60.00' to 'Q1 0.00' where '0.00'" in one.trouble for one in guards(project)))
    board.sketch.always.clear()
    wait_for(lambda: guards(project) == [])
    assert board.sketch.heaters == (0.0, 0.0)


@pytest.mark.parametrize("how", ["unplugged", "on the same line"])
def test_the_guard_leaves_another_device_alone_and_goes_on_looking_for_its_own(
    board: Served, project: Path, how: str
) -> None:
    with begin(project, "run", "heating.yaml", "--port", board.url) as run:
        wait_for(lambda: board.sketch.heaters == (60.0, 0.0))
        if how == "unplugged":
            board.unplugged = True
            time.sleep(0.5)
        mine, neighbour = board.sketch, Sketch(lambda: 0.0)
        neighbour.always["VER"] = b"TCLab Firmware 1.4.0 of the neighbour\r\n"
        neighbour.take(b"Q1 77\nQ2 33\n")
        board.sketch = neighbour
        board.unplugged = False
        out, err = run.communicate(timeout=600)
    assert run.returncode == 1
    log = next((project / "runs").glob("*/log.jsonl")).read_text(encoding="utf-8")
    assert "another device answers than before" in log
    assert "OUTPUTS NOT CONFIRMED SAFE: heater_1" in " ".join((out + err).split())
    wait_for(lambda: [guard for guard in guards(project) if guard.attempts > 1])
    assert neighbour.heaters == (77.0, 33.0)
    asked = set(neighbour.received[2:])
    assert asked <= {"VER"} | ({"T1", "T2", "R1", "R2"} if how == "on the same line" else set())
    (guard,) = guards(project)
    assert guard.identity == {"firmware": "1.4.0 Arduino Uno"}
    assert "neighbour" in guard.trouble
    board.sketch = mine
    wait_for(lambda: mine.heaters == (0.0, 0.0))
    wait_for(lambda: guards(project) == [])


def test_an_acknowledged_off_that_is_not_carried_out_is_reported_however_the_run_ends(
    board: Served, project: Path
) -> None:
    """Also when the procedure itself has switched off last, and was answered."""
    (project / "heating.yaml").write_text(SWITCHING, encoding="utf-8")
    run = begin(project, "run", "heating.yaml", "--port", board.url, "--json")
    wait_for(lambda: board.sketch.heaters == (60.0, 0.0))
    lie(board)
    out, err = run.communicate(timeout=600)
    answer = json.loads(out)
    assert (run.returncode, answer["status"], answer["unconfirmed"]) == (1, "failed", "heater_1 60 %")
    assert "OUTPUTS NOT CONFIRMED SAFE" in err
    kept = json.loads((Path(answer["path"]) / "run.json").read_text(encoding="utf-8"))
    assert kept["unconfirmed"] == "heater_1 60 %"
    page = (project / "page.html", "report", Path(answer["path"]).name)
    assert rigctl(project, *page[1:], "--output", str(page[0]))[0] == 0
    assert "heater_1 60 % may still be on" in page[0].read_text(encoding="utf-8")
    wait_for(lambda: any("'60.00' to 'R1'" in guard.trouble for guard in guards(project)))

    code, out, _ = rigctl(project, "off", "--rig", "board.yaml", "--port", board.url, "--json")
    told = json.loads(out)
    assert (code, told["confirmed"]) == (1, False)
    assert "heater_1 is 60 %, though it was commanded to be 0 %" in told["known_by"]
    wait_for(lambda: guards(project))  # 'rigctl off' leaves a guard behind as well
    board.sketch.always.clear()
    wait_for(lambda: board.sketch.heaters == (0.0, 0.0))
    wait_for(lambda: guards(project) == [])


def test_check_warns_of_a_device_without_a_watchdog(project: Path) -> None:
    code, out, _ = rigctl(project, "check", "heating.yaml")
    assert code == 0
    assert "no watchdog of its own: heater_1, heater_2 would stay on if this computer dies" in " ".join(
        out.split()
    )
