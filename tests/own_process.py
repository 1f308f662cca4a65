"""Commands in separate processes, as started by a user's shell."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import time
from contextlib import suppress
from pathlib import Path

from systems import own_state

_INSTALLED = shutil.which("rigctl", path=sysconfig.get_path("scripts"))
#: the installed command; on Windows it may be a module only, and -P leaves out the working folder
RIGCTL = (
    [sys.executable, "-P", "-m", "rigctl"] if os.name == "nt" and not _INSTALLED else [_INSTALLED or "rigctl"]
)


def begin(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """A command that runs beside the test; its locks and guards are in the folder."""
    return subprocess.Popen(
        [sys.executable, "-m", "rigctl", *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **own_state(folder / "state")},
    )


def rigctl(folder: Path, *arguments: str) -> tuple[int, str, str]:
    """A command to its end: exit code, answer and messages."""
    with begin(folder, *arguments) as process:
        out, err = process.communicate(timeout=600)
    return process.returncode, out, err


def end_guards(folder: Path) -> None:
    """Take away the notices of guards that still try to reach a board that a test has closed."""
    guards = folder / "rigctl" / "guards"
    if not guards.exists():
        return
    for _ in range(20):  # a guard that yields may need a second notice
        for notice in guards.glob("*.json"):
            with suppress(OSError):
                notice.unlink()
        time.sleep(0.01)
