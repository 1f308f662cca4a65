"""Commands that read for seconds on a busy computer say on a terminal what they are doing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rigctl.cli.commands.init import create_project

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX terminal")


@pytest.mark.parametrize(
    ("words", "sign"),
    [
        (["check", "procedures/quick-check.yaml"], "Reading procedures/quick-check.yaml"),
        (["check", "rigs/hl32-bench.yaml"], "Reading rigs/hl32-bench.yaml"),
        (["import", "data/hl32-viscosity.csv"], "Reading hl32-viscosity.csv"),
    ],
)
def test_a_terminal_is_told_what_is_being_read_and_a_file_is_not(
    tmp_path: Path, words: list[str], sign: str
) -> None:
    create_project(tmp_path)
    command = [sys.executable, "-m", "rigctl", *words]
    ours, theirs = os.openpty()
    done = subprocess.run(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=theirs, check=False,
        env={**os.environ, "TERM": "xterm"},
    )  # fmt: skip
    os.close(theirs)
    shown = os.read(ours, 1 << 16).decode("utf-8", "replace")
    os.close(ours)
    assert done.returncode == 0, shown
    assert sign in shown
    plain = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert sign not in plain.stderr
