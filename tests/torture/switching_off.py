"""How soon `rigctl off`, as a separate process, is done on each kind of bench and despite each obstacle.

Outputs are observed at the emulated board's pins, or in the lines received by the stand-in of the two-heater
board. The times depend on how busy the computer is: the test suite checks only the effects.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

from board_emulation import Emulation
from own_process import begin
from patience import patient
from rigctl.backends.registry import address_of
from rigctl.backends.transport.address_key import file_name
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig
from tclab_board import Served

HEATING = "procedure: p\nrig: rigs/RIG.yaml\nsteps:\n  - set: {heater_1: 60 %}\n  - wait: 1 h\n"


@dataclass(frozen=True)
class Off:
    """One call.

    Parameters
    ----------
    seconds: from the start of the process to its end.
    cpu: s of processor, its guard's included: what a quiet computer cannot spare.
    first_word: s until it first said anything.
    dark: s until the last output was off, where the witness saw one switched; None where none was on.
    """

    code: int
    out: str
    err: str
    seconds: float
    first_word: float
    cpu: float
    dark: float | None = None

    @property
    def told(self) -> dict[str, object]:
        answer: dict[str, object] = json.loads(self.out)
        return answer


@dataclass
class Tally:
    """Seconds of every case, slowest of all trials; see `Off`."""

    seconds: dict[str, float] = field(default_factory=dict)
    first_word: dict[str, float] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)
    dark: dict[str, float] = field(default_factory=dict)
    load: float = 0.0


def off(folder: Path, *arguments: str) -> Off:
    """Call `rigctl off`."""

    def read(stream: IO[str]) -> tuple[float, str]:
        first = stream.read(1)
        return time.monotonic() if first else math.inf, first + stream.read()

    before, began = os.times(), time.monotonic()
    with begin(folder, "off", *arguments, "--json") as process, ThreadPoolExecutor(2) as readers:
        assert process.stdout is not None
        assert process.stderr is not None
        (first, out), (first_error, err) = readers.map(read, (process.stdout, process.stderr))
        process.wait(600)
    took, after = time.monotonic() - began, os.times()
    first = min(first, first_error) - began
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return Off(process.returncode, out, err, took, first, cpu)


def project(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "rigs").mkdir(parents=True)
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    for name in ("tclab-board", "heater-board"):
        text = HEATING.replace("RIG", name)
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
        shutil.copy(shipped("rigs", f"{name}.yaml"), folder / "rigs")
    shutil.copy(shipped("rigs", "hl32-bench-uno.yaml"), folder / "rigs")
    return folder


@contextmanager
def heated() -> Iterator[Served]:
    """The two-heater board with a heater on and no host."""
    with Served() as board:
        board.sketch.model._Q1 = 60
        yield board


def _on_heaters(
    folder: Path, *arguments: str, before: Callable[[Path, str], object] = lambda *_: None
) -> Off:
    with heated() as board:
        before(folder, board.url)
        began = time.monotonic()
        done = off(folder, *arguments, "--port", board.url)
        assert board.sketch.heaters == (0.0, 0.0)
        dark = board.switched[-1][0] - began
    assert done.code == 0, done.err
    assert (done.told["confirmed"], done.told["known_by"]) == (True, "read back from the bench")
    return replace(done, dark=dark)


def lines_with_rig(folder: Path) -> Off:
    """A device that is spoken to in lines."""
    return _on_heaters(project(folder), "--rig", "rigs/tclab-board.yaml")


def only_a_port(folder: Path) -> Off:
    """The same, without a project and without a rig."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return _on_heaters(folder)


def corrupt_lock(folder: Path) -> Off:
    """The same, behind an unreadable lock."""

    def corrupt(where: Path, url: str) -> None:
        locks = where / "state" / "rigctl" / "locks"
        locks.mkdir(parents=True)
        name = file_name(address_of(load_rig(shipped("rigs", "tclab-board.yaml")), url).key)
        (locks / f"{name}.json").write_text('{"pid": "x", "token": 1', encoding="utf-8")

    return _on_heaters(project(folder), "--rig", "rigs/tclab-board.yaml", before=corrupt)


def _wait_for(condition: Callable[[], object], process: subprocess.Popen[str]) -> None:
    give_up = time.monotonic() + 600.0
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < give_up, "waited in vain"
        time.sleep(0.02)


def running_run(folder: Path) -> Off:
    """A run on a line-based device is in progress, and has the port."""
    rig = project(folder) / "rigs" / "tclab-board.yaml"
    rig.write_text(patient(rig.read_text(encoding="utf-8")), encoding="utf-8")  # only `off` is to end it
    with Served() as board:
        run = begin(folder, "run", "tclab-board.yaml", "--port", board.url, "--json")
        try:
            _wait_for(lambda: board.sketch.heaters == (60.0, 0.0), run)
            began = time.monotonic()
            done = off(folder, "--rig", "rigs/tclab-board.yaml", "--port", board.url)
            dark = board.switched[-1][0] - began
            assert board.sketch.heaters == (0.0, 0.0)
            answer = json.loads(run.communicate(timeout=600)[0])
        finally:
            run.kill()
            run.communicate()
    assert (done.code, done.told["confirmed"], answer["status"]) == (0, True, "aborted"), done.err
    assert len(done.told["ended"]) == 1  # type: ignore[arg-type]
    return replace(done, dark=dark)


def running_simulation(folder: Path) -> Off:
    """A simulation is in progress."""
    project(folder)
    run = begin(folder, "simulate", "heater-board.yaml", "--speed", "1x", "--json")
    try:
        _wait_for(lambda: any('"running"' in p.read_text() for p in folder.glob("runs/2*/state.json")), run)
        done = off(folder, "--rig", "rigs/heater-board.yaml", "--backend", "simulated")
        answer = json.loads(run.communicate(timeout=600)[0])
    finally:
        run.kill()
        run.communicate()
    assert (done.code, done.told["confirmed"], answer["status"]) == (0, True, "aborted"), done.err
    return done


def _on_board(folder: Path, *arguments: str) -> Off:
    emulation = Emulation(load_rig(shipped("rigs", "hl32-bench-uno.yaml")), folder / "port")
    try:
        emulation.board.avr.send(b"OUTP:HEAT ON\n")
        done = off(folder, *arguments, "--port", str(emulation.name))
        assert emulation.board.outputs == (False, False, False)
    finally:
        emulation.close()
    assert done.code == 0, done.err
    assert done.told["confirmed"] is True
    assert "read back" in str(done.told["known_by"])
    return done


def board_with_rig(folder: Path) -> Off:
    """rigctl's own board; its heater was on, and its own watchdog may have been sooner."""
    return _on_board(project(folder), "--rig", "rigs/hl32-bench-uno.yaml")


def board_with_only_a_port(folder: Path) -> Off:
    """The same, without a project and without a rig."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return _on_board(folder)


def dead_line(folder: Path) -> Off:
    """The port exists, but no device answers: reported soon, and again when the attempt is given up."""
    with heated() as board:
        board.mute = True
        done = off(project(folder), "--rig", "rigs/tclab-board.yaml", "--port", board.url)
    assert done.code == 1
    assert done.err.startswith("no answer yet"), "it is said before it is given up"
    assert done.err.count("by hand") == 2
    assert "rigctl off" not in done.err
    return done


def no_port(folder: Path) -> Off:
    """The port does not exist."""
    done = off(project(folder), "--rig", "rigs/hl32-bench-uno.yaml", "--port", str(folder / "nothing"))
    assert done.code == 1
    assert "by hand" in done.err
    return done


CASES = (
    *(lines_with_rig, only_a_port, corrupt_lock, running_run, running_simulation),
    *(board_with_rig, board_with_only_a_port, dead_line, no_port),
)


def torture(folder: Path, trials: int) -> Tally:
    """Call each kind in turn; their effects are checked here, their times are left to the reader."""
    tally = Tally()
    for _ in range(trials):
        for case in CASES:
            done, name = case(folder / case.__name__), case.__name__
            for kept in ("seconds", "first_word", "cpu", "dark"):
                took, slowest = getattr(done, kept), getattr(tally, kept)
                if took is not None:
                    slowest[name] = round(max(took, slowest.get(name, 0.0)), 2)
    tally.load = os.getloadavg()[0]
    return tally
