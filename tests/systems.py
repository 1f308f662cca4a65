"""What tests need of the operating system, and what is different on another one."""

from __future__ import annotations

import ctypes
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest


def needs_posix(what: str) -> pytest.MarkDecorator:
    """Mark a test that cannot run on Windows, with what is not there."""
    return pytest.mark.skipif(os.name != "posix", reason=f"needs {what}, which Windows has not")


def needs_windows_itself(what: str) -> pytest.MarkDecorator:
    """Mark a test that runs on Windows, as far as is known, but not under Wine, with what is not there."""
    under_wine = sys.platform == "win32" and hasattr(ctypes.WinDLL("ntdll"), "wine_get_version")
    return pytest.mark.skipif(under_wine, reason=f"needs {what}, which Wine has not")


#: the emulated board
needs_simavr = pytest.mark.skipif(sys.platform != "linux", reason="simavr is packaged for Linux only")

#: a C compiler; under Wine `tools/windows-under-wine` installs one
needs_compiler = pytest.mark.skipif(
    os.name == "nt" and not any(map(shutil.which, ("cc", "gcc", "clang", "cl"))),
    reason="needs a C compiler, which is not installed there",
)


def needs_package(name: str) -> pytest.MarkDecorator:
    """Mark a test that needs a package which `tools/windows-under-wine` does not install."""
    found = find_spec(name) if os.name == "nt" else None
    missing = os.name == "nt" and (
        found is None or found.origin is None
    )  # no origin: a mere folder, as build/ is
    return pytest.mark.skipif(missing, reason=f"needs {name}, which is not installed there")


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


def words_of(command: str) -> list[str]:
    """The words of a command that was printed, as this system's shell reads them: PowerShell on Windows."""
    if os.name == "nt":
        command = re.sub("'((?:[^']|'')*)'", lambda found: shlex.quote(found[1].replace("''", "'")), command)
    return shlex.split(command)


def listed_ports(monkeypatch: pytest.MonkeyPatch, comports: Callable[[], object]) -> None:
    """Let pyserial list these ports; its own module calls the system on import, which fails under Wine."""
    monkeypatch.setitem(sys.modules, "serial.tools.list_ports", SimpleNamespace(comports=comports))
