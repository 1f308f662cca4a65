"""A run that asks on the page with an output on, when the page or its server is gone."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rigctl.dataset.recording.writer_lock import read_state
from rigctl.files.shipped import shipped
from rigctl.runner.operators.remote_control import CONTROL_NAME
from web.serving import serving
from web.watched import listening, wait_for

ASK = """\
procedure: ask
rig: bench.yaml
steps:
  - set: {heater: on}
  - prompt: Is the door closed?
finally:
  - set: {heater: off}
"""


def written(folder: Path, unattended_for: str) -> Path:
    """A project whose bench is simulated in real time."""
    folder.mkdir()
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    (folder / "ask.yaml").write_text(ASK, encoding="utf-8")
    text = shipped("rigs", "hl32-bench.yaml").read_text(encoding="utf-8")
    assert "stale_after: 1 s " in text  # a busy machine may stop the simulated bench for longer
    text = text.replace("stale_after: 1 s ", f"unattended_for: {unattended_for}\nstale_after: 60 s ")
    (folder / "bench.yaml").write_text(text, encoding="utf-8")
    return folder


@contextmanager
def asking(project: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """A run that waits for its answer, with its folder."""
    command = ["run", "ask.yaml", "--backend", "simulated", "--answer-in-browser", "--json"]
    run = subprocess.Popen(
        [sys.executable, "-m", "rigctl", *command],
        cwd=project,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )

    def asked() -> Any:
        folders = list((project / "runs").glob("*")) if (project / "runs").is_dir() else []
        state = read_state(folders[0]) if folders else None
        return folders[0] if state is not None and state.fields.get("asked") else None

    try:
        wait_for(asked)
        yield run, asked()
    finally:
        run.kill()
        run.communicate(timeout=120)


def events(folder: Path, kind: str) -> list[dict[str, Any]]:
    lines = (folder / "log.jsonl").read_text(encoding="utf-8").splitlines()
    return [event for line in lines if (event := json.loads(line)).get("kind") == kind]


def presence(folder: Path) -> list[str]:
    """What the operator's events say about somebody's presence."""
    told = [event["message"] for event in events(folder, "operator")]
    return [text.partition(",")[0] for text in told if "nobody" in text or "somebody" in text]


def test_a_run_whose_server_is_killed_ends_with_its_outputs_off(tmp_path: Path) -> None:
    project = written(tmp_path / "project", "10 s")
    with (
        serving(project, "--port", "0", state=tmp_path / "state", ends=-9) as served,
        asking(project) as (run, folder),
    ):
        with listening(served, served.enter(), "first") as page:
            page.want(folder.name)
            page.hear_until(lambda: page.told.get("state", {}).get("asked"))
            wait_for(lambda: b"present" in (folder / CONTROL_NAME).read_bytes())
            assert presence(folder) == []
            served.process.kill()
        printed, said = run.communicate(timeout=120)
    ended = json.loads(printed)
    assert (ended["status"], ended["exit_code"], run.returncode) == ("failed", 1, 1), said
    reason = "'Is the door closed?' was not answered, and nobody was there for 10 s, with heater on"
    assert reason in ended["reason"]
    assert presence(folder) == ["nobody is there"]
    heater = [event["value"] for event in events(folder, "command") if event["actuator"] == "heater"]
    assert heater == [1.0, 0.0, 0.0]  # as soon as the bound was reached, and by the procedure's own cleanup


def test_a_page_that_comes_back_in_time_can_answer(tmp_path: Path) -> None:
    project = written(tmp_path / "project", "10 min")
    with (
        serving(project, "--port", "0", state=tmp_path / "state") as served,
        asking(project) as (run, folder),
    ):
        cookie = served.enter()
        with listening(served, cookie, "first") as page:
            page.want(folder.name)
            page.hear_until(lambda: page.told.get("state", {}).get("asked"))
        wait_for(lambda: presence(folder) == ["nobody is there"])
        with listening(served, cookie, "first") as page:
            page.want(folder.name)
            wait_for(lambda: presence(folder) == ["nobody is there", "somebody is there again"])
            answer = {"question": "Is the door closed? [Enter]", "text": ""}
            status, told = served.post(f"/api/live/{folder.name}/answer", answer, cookie, "first")
            assert status == 200, told
            printed, _ = run.communicate(timeout=120)
    assert json.loads(printed)["status"] == "finished"
