"""rigctl and its guard as real processes on the stand-in of the two-heater board: killed and stopped.

The board has no protection of its own; its heaters are observed. The times measured here depend on how busy
the computer is, so the test suite does not run this.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.dataset import open_run, verify
from rigctl.files.shipped import shipped
from systems import own_state
from tclab_board import Served

HEATING = """\
procedure: heating
rig: board.yaml
steps:
  - set: {heater_1: 60 %}
  - record: {name: heating, rate: 10 Hz}
    do:
      - wait: 1 h
"""
ENDINGS = (
    *("SIGINT", "SIGTERM", "SIGHUP"),
    *("host killed", "host stands still", "guard killed", "guard stands still", "line dead"),
)
#: s from the cause to the heater off, as stated in `safety.md`, doubled for a busy computer
BOUNDS = {
    **dict.fromkeys(("SIGINT", "SIGTERM", "SIGHUP"), 1.0),
    "host killed": 1.0,
    "host stands still": 4.0,
    "guard killed": 4.0,
}


@dataclass
class Tally:
    """What happened over all endings of real processes; times are s."""

    endings: int = 0
    slowest_off: dict[str, float] = field(default_factory=dict)
    statuses: dict[str, int] = field(default_factory=dict)
    said_unconfirmed: int = 0
    failures: list[str] = field(default_factory=list)


def _wait_for(condition: Callable[[], object], patience: float = 60.0) -> None:
    give_up = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < give_up, "waited in vain"
        time.sleep(0.01)


def _guard_of(host: int) -> int:
    """The guard's process id."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[1])
            command = (entry / "cmdline").read_bytes()
        except OSError:
            continue
        if parent == host and b"rigctl.backends.transport.guard" in command:
            return int(entry.name)
    raise AssertionError("no guard")


def _project(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    (folder / "heating.yaml").write_text(HEATING, encoding="utf-8")
    text = shipped("rigs", "tclab-board.yaml").read_text(encoding="utf-8")
    changed = text.replace("wake: 5 s", "wake: 0.5 s").replace("stale_after: 5 s", "stale_after: 2 s")
    (folder / "board.yaml").write_text(changed, encoding="utf-8")
    return folder


def _apply(how: str, host: subprocess.Popen[str], board: Served, rng: random.Random) -> None:
    """End the run; a suspended process continues afterwards."""
    guard = _guard_of(host.pid)
    match how:
        case "host killed":
            host.kill()
        case "host stands still":
            host.send_signal(signal.SIGSTOP)
            time.sleep(rng.uniform(4.5, 6.0))
            host.send_signal(signal.SIGCONT)
        case "guard killed":
            os.kill(guard, signal.SIGKILL)
        case "guard stands still":
            os.kill(guard, signal.SIGSTOP)
            _wait_for(lambda: host.poll() is not None)
            os.kill(guard, signal.SIGCONT)
        case "line dead":
            board.mute = True
            _wait_for(lambda: host.poll() is not None)
            board.mute = False
        case _:
            host.send_signal(getattr(signal, how))


def one(folder: Path, seed: str, how: str, tally: Tally) -> None:
    """One run, and how it ends.

    Raises
    ------
    AssertionError
        the heater stays on, is switched on again, or the run does not report its ending correctly.
    """
    rng, project = random.Random(seed), _project(folder)
    with Served() as board:
        host = subprocess.Popen(
            [sys.executable, "-m", "rigctl", "run", "heating.yaml", "--port", board.url, "--json"],
            cwd=project,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **own_state(project / "state")},
        )
        try:
            _wait_for(lambda: board.sketch.heaters == (60.0, 0.0) or host.poll() is not None)
            assert host.poll() is None, host.communicate()
            time.sleep(rng.uniform(0.0, 2.5))
            began = time.monotonic()
            _apply(how, host, board, rng)
            out, err = host.communicate(timeout=90.0)
            _wait_for(lambda: board.sketch.heaters == (0.0, 0.0))
            time.sleep(1.0)
        finally:
            host.kill()
            host.communicate()
        _judge(project, how, (host.returncode, out, err), board, began, tally)


def _judge(
    project: Path, how: str, ended: tuple[int, str, str], board: Served, began: float, tally: Tally
) -> None:
    code, out, err = ended
    tally.endings += 1
    after = [(at - began, heaters) for at, heaters in board.switched if at > began]
    assert [heaters for _, heaters in after] == [(0.0, 0.0)], f"{how}: off once, and not on again: {after}"
    took = after[0][0]
    tally.slowest_off[how] = round(max(took, tally.slowest_off.get(how, 0.0)), 3)
    assert took <= BOUNDS.get(how, 90.0), f"{how}: off after {took:.2f} s"
    assert "Traceback" not in err, err
    (folder,) = (project / "runs").glob("2*")
    assert verify(folder).good
    samples = open_run(folder).table("samples")["time"].to_numpy()
    assert len(samples) > 0
    said = json.loads(out) if out.strip() else {"status": "killed", "unconfirmed": None}
    tally.statuses[f"{how}: {said['status']}"] = tally.statuses.get(f"{how}: {said['status']}", 0) + 1
    tally.said_unconfirmed += bool(said["unconfirmed"])
    if how == "host killed":
        assert code == -signal.SIGKILL
    elif how in ("SIGINT", "SIGTERM", "SIGHUP"):
        assert (code, said["status"]) == (130 if how == "SIGINT" else 143, "aborted"), (code, said)
        assert how in said["reason"]
    else:
        assert (code, said["status"]) == (1, "failed"), (code, said)
        assert said["reason"]
        assert bool(said["unconfirmed"]) is (how in ("guard stands still", "line dead")), (how, said)


def torture(folder: Path, trials: int, seed: int | str) -> Tally:
    """So many endings in turn of each kind; those that broke a promise are `Tally.failures`."""
    tally = Tally()
    for number in range(trials):
        how = ENDINGS[number % len(ENDINGS)]
        try:
            one(folder / "trial", f"{seed}-{number}", how, tally)
        except AssertionError as problem:
            tally.failures.append(f"{how} {number} of seed {seed}: {problem}")
    return tally
