"""What tests need of the operating system, and what is different on another one."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import pytest


def needs_posix(what: str) -> pytest.MarkDecorator:
    """Mark a test that cannot run on Windows, with what is not there."""
    return pytest.mark.skipif(os.name != "posix", reason=f"needs {what}, which Windows has not")


#: a program sends another one Ctrl-C
needs_signals = needs_posix("a signal from one program to another")


def own_state(folder: Path) -> dict[str, str]:
    """Variables that put rigctl's locks, notices of guards and rescued data into a folder."""
    return dict.fromkeys(("XDG_STATE_HOME", "XDG_DATA_HOME", "WIN_PD_OVERRIDE_LOCAL_APPDATA"), str(folder))


def interrupt(process: subprocess.Popen[str]) -> None:
    """Ctrl-C; on Windows, where no program sends it to another, end the process at once."""
    if os.name == "posix":
        process.send_signal(signal.SIGINT)
    else:
        process.terminate()
