"""`rigctl doctor --align` asked at a real pseudo-terminal: yes, no, and Ctrl-C."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.files.shipped import shipped
from rigctl.rig import load_rig
from several_devices import ALIGN, SeveralDevices, patient_devices, wired_devices
from systems import needs_posix, own_state

pytestmark = needs_posix("a pseudo-terminal")

READY = "Is the bench ready for it?"
CTRL_C = "\x03"
WRITE = "Write this to the rig file?"

#: Ctrl-C is a signal to the processes of the session whose own terminal it is typed at
_AT_TERMINAL = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-m", "rigctl", *sys.argv[1:]])
"""


@pytest.fixture(scope="module")
def devices() -> Iterator[SeveralDevices]:
    with wired_devices() as served:
        yield served


@pytest.fixture
def project(devices: SeveralDevices, tmp_path: Path) -> Path:
    devices.circuit.switched.clear()
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    text = shipped("rigs", "oil-circuit-devices.yaml").read_text(encoding="utf-8")
    (tmp_path / "rig.yaml").write_text(patient_devices(text) + ALIGN, encoding="utf-8")
    return tmp_path


class Terminal:
    """A command whose input, output and messages are a pseudo-terminal, and what has been printed."""

    def __init__(self, folder: Path, devices: SeveralDevices) -> None:
        self._end, other = os.openpty()
        self.text = ""
        self.process = subprocess.Popen(
            [sys.executable, "-c", _AT_TERMINAL, "doctor", "--align", "--rig", "rig.yaml", *devices.options],
            cwd=folder,
            stdin=other,
            stdout=other,
            stderr=other,
            start_new_session=True,
            env={**os.environ, **own_state(folder / "state"), "TERM": "xterm", "COLUMNS": "400"},
        )
        os.close(other)

    def type(self, text: str) -> None:
        os.write(self._end, text.encode())

    def read_until(self, text: str) -> None:
        while text not in " ".join(self.text.split()):
            assert self._more(), self.text

    def end(self) -> int:
        """Read to the end, and return the exit code."""
        while self._more():
            pass
        os.close(self._end)
        return self.process.wait(60.0)

    def _more(self) -> bool:
        assert select.select([self._end], [], [], 600.0)[0], self.text
        try:
            data = os.read(self._end, 65536)
        except OSError:  # how Linux reports that the other end is closed
            return False
        self.text += data.decode("utf-8", "replace")
        return bool(data)


@pytest.fixture
def terminal(project: Path, devices: SeveralDevices) -> Iterator[Terminal]:
    made = Terminal(project, devices)
    yield made
    if made.process.poll() is None:
        made.process.kill()
        made.process.wait()


def test_no_moves_nothing(terminal: Terminal, devices: SeveralDevices) -> None:
    terminal.read_until(READY)
    assert "relief_valve is set to 30 bar and back to 0 bar, 5 times in 20 s" in terminal.text
    terminal.type("n\n")
    assert terminal.end() == 2
    assert "nothing was moved" in terminal.text
    assert not devices.circuit.switched


def test_interrupt_at_the_question_moves_nothing(terminal: Terminal, devices: SeveralDevices) -> None:
    terminal.read_until(READY)
    terminal.type(CTRL_C)
    assert terminal.end() == 130
    assert "Traceback" not in terminal.text
    assert not devices.circuit.switched


def test_interrupt_while_it_moves_leaves_outputs_off_and_the_file_alone(
    terminal: Terminal, devices: SeveralDevices, project: Path
) -> None:
    before = (project / "rig.yaml").read_text("utf-8")
    terminal.read_until(READY)
    terminal.type("y\n")
    give_up = time.monotonic() + 600.0
    while not devices.circuit.outputs["relief_valve"]:
        assert time.monotonic() < give_up
        time.sleep(0.01)
    terminal.type(CTRL_C)
    assert terminal.end() == 130
    assert "Traceback" not in terminal.text
    assert WRITE not in terminal.text
    assert devices.circuit.off
    assert (project / "rig.yaml").read_text("utf-8") == before


@pytest.mark.parametrize("write", [True, False])
def test_the_rig_file_is_written_if_the_second_answer_is_yes(
    terminal: Terminal, devices: SeveralDevices, project: Path, write: bool
) -> None:
    before = (project / "rig.yaml").read_text("utf-8")
    terminal.read_until(READY)
    terminal.type("y\n")
    terminal.read_until(WRITE)
    assert devices.circuit.off
    terminal.type("y\n" if write else "n\n")
    assert terminal.end() == 0, terminal.text
    if not write:
        assert (project / "rig.yaml").read_text("utf-8") == before
        return
    assert load_rig(project / "rig.yaml").clocks["controller"].offset == pytest.approx(-0.25, abs=0.15)
