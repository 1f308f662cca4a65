"""`rigctl emulate` and `rigctl run --backend emulated`, as a person types them."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rigctl.cli.main import app
from rigctl.files.shipped import shipped
from systems import own_state

#: a shell starts background commands with Ctrl-C ignored
AS_BACKGROUND_JOB = """\
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
from rigctl.cli.main import main
"""


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_any_client_can_talk_to_the_emulated_board_until_it_is_ended(
    tmp_path: Path, end: signal.Signals
) -> None:
    import serial

    link = tmp_path / "ttyRIG"
    command = [sys.executable, "-c", f"{AS_BACKGROUND_JOB}main()", "emulate", "--link", str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == f"{link} at 115200 baud; Ctrl-C ends it\n"
            with serial.Serial(str(link), 115200, timeout=60) as port:
                port.write(b"*IDN?\n")
                assert port.readline() == b"RIGCTL,RIG-UNO,0,1.1.1\n"
            process.send_signal(end)
            assert process.wait(600) == 0
        finally:
            process.kill()
    assert not link.is_symlink()


def test_a_file_is_never_replaced_by_a_port_link(tmp_path: Path) -> None:
    rig = tmp_path / "bench.yaml"
    rig.write_text("rig: mine\n", encoding="utf-8")
    done = CliRunner().invoke(app, ["emulate", "--link", str(rig)])
    assert done.exit_code != 0
    assert "a file already" in str(done.exception)
    assert rig.read_text(encoding="utf-8") == "rig: mine\n"


def test_a_procedure_runs_on_the_emulated_board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for name, value in own_state(tmp_path / "state").items():
        monkeypatch.setenv(name, value)
    procedure = shipped("procedures", "quick-check.yaml")
    rig = shipped("rigs", "hl32-bench-uno.yaml")
    arguments = [
        "run",
        str(procedure),
        "--rig",
        str(rig),
        "--backend",
        "emulated",
        "--speed",
        "max",
        "--json",
    ]
    result = CliRunner().invoke(app, arguments)
    told = json.loads(result.stdout)
    assert (told["status"], told["records"], told["exit_code"]) == ("finished", 2, 0)
