"""Long commands say on a terminal what they are doing before they do it, and how far they are."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigctl.cli.commands.init import create_project

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX terminal")

#: modules that take long to import, or do the work: none of them may be loaded before the first sign
_WORK = ("numpy", "scipy", "pyarrow", "numba", "rigctl.analysis", "rigctl.planning")
_HOOK = """
import importlib.abc, sys
class Told(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in {work!r}:
            sys.stderr.write("<" + name + ">")
            sys.stderr.flush()
sys.meta_path.insert(0, Told())
from rigctl.cli.entry import main
sys.argv[0] = "rigctl"
main()
"""


def _on_a_terminal(folder: Path, words: list[str]) -> str:
    """What a terminal of this command shows, with a mark where each module of `_WORK` is first looked for."""
    ours, theirs = os.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    with subprocess.Popen(
        [sys.executable, "-c", _HOOK.format(work=_WORK), *words],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=theirs, env=environment,
    ) as process:  # fmt: skip
        os.close(theirs)
        shown = b""
        while True:
            try:
                piece = os.read(ours, 1 << 16)
            except OSError:  # the terminal's other side is closed
                break
            if not piece:
                break
            shown += piece
        code = process.wait()
    os.close(ours)
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.decode("utf-8", "replace"))
    assert code == 0, text
    return text


def _long_log(folder: Path, rows: int) -> None:
    times = np.arange(rows) * 0.01
    columns = np.column_stack([times, 1.0 + 0.0 * times, 40.0 + np.sin(times)])
    heading = "time [s],valve [1],oil_temperature [degC]"
    np.savetxt(folder / "long.csv", columns, fmt="%.4f", delimiter=",", header=heading, comments="")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a run and a long log that is not imported yet."""
    folder = tmp_path_factory.mktemp("project")
    create_project(folder)
    _long_log(folder, 300_000)
    words = ["import", "data/hl32-viscosity.csv"]
    subprocess.run([sys.executable, "-m", "rigctl", *words], cwd=folder, capture_output=True, check=True)
    return folder


@pytest.mark.parametrize(
    ("words", "sign"),
    [
        ("check procedures/quick-check.yaml", "Reading procedures/quick-check.yaml"),
        ("check rigs/hl32-bench.yaml", "Reading rigs/hl32-bench.yaml"),
        ("report latest -o page.html", "Reading the runs"),
        ("diagnose latest --model models/hl32-oil.yaml", "Reading the records"),
        ("import data/hl32-viscosity.csv", "Reading hl32-viscosity.csv"),
        ("import long.csv --rig rigs/hl32-bench.yaml", "Reading long.csv"),
    ],
)
def test_the_first_sign_comes_before_the_work(project: Path, words: str, sign: str) -> None:
    shown = _on_a_terminal(project, words.split())
    before = shown[: shown.index(sign)]
    assert not [name for name in _WORK if f"<{name}>" in before], before
    assert any(f"<{name}>" in shown for name in _WORK)  # else the marks prove nothing
    if "long.csv" in words:
        assert re.search(r"Reading long\.csv: \d+ rows so far", shown)


def test_a_file_is_not_told_what_is_read_in_no_time(tmp_path: Path) -> None:
    create_project(tmp_path)
    command = [sys.executable, "-m", "rigctl", "import", "data/hl32-viscosity.csv"]
    plain = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "Reading" not in plain.stderr
