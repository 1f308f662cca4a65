"""rigctl on Windows' Python, under Wine, on a device behind COM1: told to end, or killed.

    tools/windows-under-wine endings [NUMBER] [--minutes M] [--results FILE]

Each trial is a line in the results as soon as it has ended, and those already there are not repeated: started
again, it goes on where it was, up to NUMBER endings in all. Where rigctl ended before it was told to, as it
does when a busy computer cannot keep the rate of the record, nothing was tested, and another trial follows.

The device is the stand-in of the two-heater board, which has no protection of its own, on a pseudo-terminal
that is Wine's COM1. Wine is not Windows: drivers, and how long Windows lets a process live, are not shown.
A log-off and a shutdown are not among them: Windows tells no program of a user about them.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from scipy import stats

from rigctl.dataset import open_run, verify
from rigctl.errors import RigctlError
from tclab_board import Served
from torture.guarded import _project, _wait_for

ROOT = Path(__file__).parents[2]
WINDOWS = Path(os.environ.get("RIGCTL_WINDOWS", ROOT / ".windows"))
#: exit code of each ending; None: of a process that something else has ended
ENDINGS: dict[str, int | None] = {
    "Ctrl-C": 130,
    "Ctrl-Break": 143,
    "console closed": 143,
    "terminated": None,
    "job ended": None,
}
#: s until rigctl heats, until it has ended after it was told to, and until the heater is off after that
STARTS, ENDS, OFF = 600.0, 120.0, 30.0


@dataclass(frozen=True)
class Trial:
    """One ending, as a line of the results."""

    number: int
    how: str
    outcome: (
        str  #: safe; said: not safe, and rigctl says so; UNSAFE; wrong: safe, but reported wrongly; untested
    )
    off: float | None = None  #: s until the heater was off
    problem: str = ""
    moment: float | None = None  #: s of heating before the ending


class Untested(Exception):
    """The ending was not reached."""


def windows_path(path: Path) -> str:
    """The path as Wine's programs have it."""
    return "Z:" + str(path).replace("/", "\\")


def _start(project: Path) -> subprocess.Popen[str]:
    """The process that runs rigctl there, which waits for the ending to be named on its stdin."""
    tool = [str(ROOT / "tools" / "windows-under-wine"), "python"]
    script = windows_path(Path(__file__).parent / "windows_host.py")
    state = windows_path(project / "state")
    return subprocess.Popen(
        [*tool, script, "run", "heating.yaml", "--port", "COM1", "--json"],
        cwd=project,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        env={**os.environ, "WIN_PD_OVERRIDE_LOCAL_APPDATA": state},
        start_new_session=True,
    )


def _end(host: subprocess.Popen[str]) -> None:
    """End what the trial has started, the shell and what it runs."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(host.pid, signal.SIGKILL)
    host.communicate()


def _is_off(board: Served, patience: float) -> bool:
    try:
        _wait_for(lambda: board.sketch.heaters == (0.0, 0.0), patience)
    except AssertionError:
        return False
    return True


def _told(host: subprocess.Popen[str], how: str) -> tuple[str, str]:
    """End it so; what it printed, and what kept it from ending, if anything."""
    try:
        return host.communicate(how + "\n", timeout=ENDS)
    except subprocess.TimeoutExpired:
        return "", f"had not ended {ENDS:.0f} s after it was told to"


def one(folder: Path, seed: str, number: int, how: str) -> Trial:
    """One run and its ending.

    Raises
    ------
    Untested
        rigctl did not begin to heat.
    """
    moment, project = random.Random(f"{seed}-{number}").uniform(0.0, 2.5), _project(folder)
    com = WINDOWS / "prefix" / "dosdevices" / "com1"
    with Served(pty=True) as board:
        com.unlink(missing_ok=True)
        com.symlink_to(board.url)
        host = _start(project)
        try:
            try:
                _wait_for(lambda: board.sketch.heaters == (60.0, 0.0) or host.poll() is not None, STARTS)
            except AssertionError:
                raise Untested(f"rigctl had not begun to heat after {STARTS:.0f} s") from None
            if host.poll() is not None:
                raise Untested(f"rigctl had ended before: {_reason(*host.communicate())}")
            time.sleep(moment)
            began = time.monotonic()
            out, err = _told(host, how)
            off = _is_off(board, OFF)
            time.sleep(1.0)
        finally:
            _end(host)
        after = [(at - began, heaters) for at, heaters in board.switched if at > began]
    if not off or [heaters for _, heaters in after] != [(0.0, 0.0)]:
        outcome = "said" if _says_unconfirmed(out) else "UNSAFE"
        return Trial(number, how, outcome, None, f"{after}: {out} {err}", moment)
    took = round(after[0][0], 3)
    try:
        _judge(project, how, out, err)
    except (AssertionError, ValueError, LookupError, OSError, RigctlError) as problem:
        return Trial(number, how, "wrong", took, f"{type(problem).__name__}: {problem}", moment)
    return Trial(number, how, "safe", took, "", moment)


def _says_unconfirmed(out: str) -> bool:
    try:
        return bool(json.loads(json.loads(out)["out"])["unconfirmed"])
    except ValueError:
        return False  # it printed nothing, or was killed


def _reason(out: str, err: str) -> str:
    """Why it ended, as far as it has said so."""
    try:
        return str(json.loads(json.loads(out)["out"])["reason"])
    except (ValueError, LookupError):
        return f"{out} {err}"


def _judge(project: Path, how: str, out: str, err: str) -> None:
    """Fail unless the run can be read, and was reported as it ended."""
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


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _tested(trials: list[Trial]) -> list[Trial]:
    return [trial for trial in trials if trial.outcome != "untested"]


def summary(trials: list[Trial]) -> list[str]:
    """Counts of each kind, the slowest, and the bound that so many trials give."""
    lines = []
    for how in ENDINGS:
        of_kind = [trial for trial in _tested(trials) if trial.how == how]
        good = [trial for trial in of_kind if trial.outcome == "safe"]
        slowest = max((trial.off or 0.0 for trial in good), default=math.nan)
        lines.append(f"{how}: {len(good)} of {len(of_kind)} safe, heater off after at most {slowest:.2f} s")
    tested = _tested(trials)
    bad = sum(trial.outcome == "UNSAFE" for trial in tested)
    upper = stats.beta.ppf(0.975, bad + 1, len(tested) - bad) if bad < len(tested) else 1.0
    lower = stats.beta.ppf(0.025, bad, len(tested) - bad + 1) if bad else 0.0
    lines += [
        f"{len(tested) - bad} of {len(tested)} endings safe, or said not to be, under Wine",
        f"{bad} neither: {lower:.2%} to {upper:.2%} of endings (95 %, Clopper-Pearson)",
        f"besides, {sum(trial.outcome == 'wrong' for trial in tested)} safe but reported wrongly, "
        f"{len(trials) - len(tested)} not tested",
    ]
    return lines


def main(wanted: int, minutes: float, results: Path, seed: str) -> int:
    """Go on to so many endings, each kind in turn, or until the minutes are over; print each, and counts."""
    trials = []
    if results.exists():
        trials = [Trial(**json.loads(line)) for line in results.read_text(encoding="utf-8").splitlines()]
    give_up = time.monotonic() + minutes * 60.0
    while len(_tested(trials)) < wanted and time.monotonic() < give_up:
        number = len(trials)
        how = list(ENDINGS)[number % len(ENDINGS)]
        with tempfile.TemporaryDirectory() as folder:
            try:
                trial = one(Path(folder) / "trial", seed, number, how)
            except Untested as problem:
                trial = Trial(number, how, "untested", None, str(problem))
        trials.append(trial)
        with results.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(trial)) + "\n")
        off = "" if trial.off is None else f", off after {trial.off:.3f} s"
        _say(f"{time.strftime('%H:%M:%S')} {number} {how}: {trial.outcome}{off} {trial.problem}")
    for line in summary(trials):
        _say(line)
    return any(trial.outcome in ("UNSAFE", "wrong") for trial in trials)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="tools/windows-under-wine endings")
    parser.add_argument(
        "number", type=int, nargs="?", default=len(ENDINGS), help="endings, with those before"
    )
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin no trial after so long")
    parser.add_argument("--results", type=Path, help="file of this and earlier results; by default a new one")
    parser.add_argument("--seed", default="0")
    return parser.parse_args()


if __name__ == "__main__":
    given = _arguments()
    with tempfile.TemporaryDirectory() as scratch:
        kept = given.results or Path(scratch) / "endings.jsonl"
        sys.exit(main(given.number, given.minutes, kept, given.seed))
