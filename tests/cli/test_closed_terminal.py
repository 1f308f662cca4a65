"""The terminal of a run is closed while the run asks a question with an output on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from patience import patient
from rigctl.files.shipped import shipped
from tclab_board import Served

if sys.platform == "win32":
    pytest.skip("a console that is closed there ends its programs", allow_module_level=True)

import fcntl
import termios

ASK = """\
procedure: ask
rig: rigs/tclab-board.yaml
steps:
  - set: {heater_1: 40 %}
  - prompt: Is the door closed?
"""


def begin(folder: Path, url: str, *, survives: bool) -> tuple[subprocess.Popen[bytes], int]:
    """A run in a session of its own, and the other end of its terminal."""
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    (folder / "rigs").mkdir()
    text = shipped("rigs", "tclab-board.yaml").read_text(encoding="utf-8")
    (folder / "rigs" / "tclab-board.yaml").write_text(patient(text), encoding="utf-8")
    (folder / "ask.yaml").write_text(ASK, encoding="utf-8")
    master, slave = os.openpty()

    def at_terminal() -> None:
        fcntl.ioctl(slave, termios.TIOCSCTTY, 0)
        signal.signal(signal.SIGHUP, signal.SIG_IGN if survives else signal.SIG_DFL)

    run = subprocess.Popen(
        [sys.executable, "-m", "rigctl", "run", "ask.yaml", "--port", url],
        cwd=folder,
        stdin=slave,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
        preexec_fn=at_terminal,  # noqa: PLW1509 - one thread
        env={**os.environ, "XDG_STATE_HOME": str(folder / "state"), "TERM": "dumb"},
    )
    os.close(slave)
    return run, master


@pytest.mark.parametrize(
    ("survives", "status", "reason", "code"),
    [
        (True, "failed", "nobody can answer 'Is the door closed?'", 1),
        (False, "aborted", "ended by SIGHUP", 143),
    ],
    ids=["SIGHUP is ignored, as under nohup", "as usual"],
)
def test_a_run_that_asks_ends_with_its_outputs_off(
    tmp_path: Path, status: str, reason: str, code: int, *, survives: bool
) -> None:
    with Served() as board:
        run, terminal = begin(tmp_path, board.url, survives=survives)
        seen = b""
        give_up = time.monotonic() + 120.0
        while b"Is the door closed?" not in seen:
            assert time.monotonic() < give_up, seen
            seen += os.read(terminal, 4096)
        assert board.sketch.heaters == (40.0, 0.0)
        os.close(terminal)
        assert run.wait(120) == code
        assert board.sketch.heaters == (0.0, 0.0)
    (folder,) = (tmp_path / "runs").iterdir()
    info = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert info["status"] == status
    assert reason in info["reason"]
