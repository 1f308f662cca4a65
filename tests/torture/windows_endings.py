"""rigctl on Windows' Python, under Wine, on a device behind COM1: told to end, or killed.

    tools/windows-under-wine endings [NUMBER]

The device is the stand-in of the two-heater board, which has no protection of its own, on a pseudo-terminal
that is Wine's COM1. Wine is not Windows: drivers, and how long Windows lets a process live, are not shown.
A log-off and a shutdown are not among them: Windows tells no program of a user about them.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from rigctl.dataset import open_run, verify
from tclab_board import Served
from torture.guarded import _project, _wait_for

ROOT = Path(__file__).parents[2]
WINDOWS = ROOT / ".windows"
#: exit code of each ending; None: of a process that something else has ended
ENDINGS: dict[str, int | None] = {
    "Ctrl-C": 130,
    "Ctrl-Break": 143,
    "console closed": 143,
    "terminated": None,
    "job ended": None,
}


def windows_path(path: Path) -> str:
    """The path as Wine's programs have it."""
    return "Z:" + str(path).replace("/", "\\")


def one(folder: Path, seed: str, how: str) -> float:
    """One run and its ending; return the time until the heater was off, in s.

    Raises
    ------
    AssertionError
        the heater stays on or is switched on again, or the run cannot be read or is reported wrongly.
    """
    rng, project = random.Random(seed), _project(folder)
    com = WINDOWS / "prefix" / "dosdevices" / "com1"
    with Served(pty=True) as board:
        com.unlink(missing_ok=True)
        com.symlink_to(board.url)
        command = [
            str(ROOT / "tools" / "windows-under-wine"),
            "python",
            windows_path(Path(__file__).parent / "windows_host.py"),
        ]
        state = windows_path(project / "state")
        host = subprocess.Popen(
            [*command, "run", "heating.yaml", "--port", "COM1", "--json"],
            cwd=project,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            env={**os.environ, "WIN_PD_OVERRIDE_LOCAL_APPDATA": state},
        )
        try:
            try:
                _wait_for(lambda: board.sketch.heaters == (60.0, 0.0) or host.poll() is not None, 180.0)
            except AssertionError:
                raise AssertionError("rigctl had not begun to heat after 180 s: nothing was tested") from None
            assert host.poll() is None, host.communicate()
            time.sleep(rng.uniform(0.0, 2.5))
            began = time.monotonic()
            out, err = host.communicate(how + "\n", timeout=120.0)
            try:
                _wait_for(lambda: board.sketch.heaters == (0.0, 0.0), 30.0)
            except AssertionError:
                raise AssertionError(f"THE HEATER IS ON, {board.switched}: {out} {err}") from None
            time.sleep(1.0)
        finally:
            host.kill()
            host.communicate()
        after = [(at - began, heaters) for at, heaters in board.switched if at > began]
        assert [heaters for _, heaters in after] == [(0.0, 0.0)], f"off once, and not on again: {after}"
    assert out.strip(), err
    ended = json.loads(out)
    assert "Traceback" not in ended["err"], ended["err"]
    (run,) = (project / "runs").glob("2*")
    assert verify(run).good
    assert len(open_run(run).table("samples")["time"].to_numpy()) > 0
    expected = ENDINGS[how]
    if expected is not None and "ended by the system" not in ended["err"]:  # too slow to close the run itself
        assert ended["code"] == expected, ended
        said = json.loads(ended["out"])
        assert (said["status"], said["unconfirmed"]) == ("aborted", None), said
    return after[0][0]


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main(trials: int, seed: str = "0") -> int:
    """So many endings, each kind in turn; print the counts and the slowest of each kind."""
    slowest: dict[str, float] = {}
    counts: Counter[str] = Counter()
    failures = []
    for number in range(trials):
        how = list(ENDINGS)[number % len(ENDINGS)]
        with tempfile.TemporaryDirectory() as folder:
            try:
                slowest[how] = max(
                    slowest.get(how, 0.0), one(Path(folder) / "trial", f"{seed}-{number}", how)
                )
                counts[how] += 1
            except AssertionError as problem:
                failures.append(f"{how}, number {number}: {problem}")
                _say(failures[-1])
    for how, count in counts.items():
        _say(f"{how}: {count} safe, heater off after at most {slowest[how]:.2f} s")
    _say(f"{sum(counts.values())} of {trials} endings safe, under Wine")
    return bool(failures)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else len(ENDINGS)))
