"""Faults of the host: disk, folder, clock, signals, a second run, a kill at any moment."""

from __future__ import annotations

import errno
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from patience import no_silence
from rigctl.clock import ScaledClock, VirtualClock
from rigctl.dataset import RunWriter, open_run, verify
from rigctl.errors import ExitCode, RigctlError
from rigctl.runner.launch import Launch
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.resume import open_interrupted, relaunch
from run_workshop import RIG, Workshop
from systems import needs_posix, needs_signals, own_state

Do = Callable[..., Any]

RECORDS = 12

PROCEDURE = """\
procedure: strokes
rig: bench.yaml
steps:
  - set: {heater: on}
  - repeat: 12
    do:
      - retract: {until: position < 1 mm, timeout: 5 s}
      - record: {name: stroke, rate: 100 Hz}
        do:
          - extend: {for: 1 s}
          - retract: {until: position < 1 mm, timeout: 5 s}
finally:
  - set: {heater: off}
"""
LONG = """\
procedure: long
rig: bench.yaml
steps:
  - set: {heater: on}
  - wait: 1 h
finally:
  - wait: 30 s
"""


# --- disk and folder ---


def test_a_full_disk_ends_the_run_safely_and_keeps_what_was_written(
    do: Do, workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = workshop.plan(PROCEDURE.split("\n", 2)[2])
    backend = workshop.backend(plan.rig)
    writer = RunWriter.create(workshop.folder / "runs", workshop.header(plan, backend))
    flush, calls = writer._journal.flush, iter(range(10**6))

    def full() -> None:
        if next(calls) == 5:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush()

    monkeypatch.setattr(writer._journal, "flush", full)
    done = do(PROCEDURE.split("\n", 2)[2], backend=backend, writer=writer)
    assert (done.result.status, done.result.exit_code) == ("failed", ExitCode.FAILED)
    assert "No space left" in done.result.reason
    assert done.commands("heater")[-1][1] == 0.0
    assert done.commands("valve")[-1][1] == 0.0
    assert verify(done.result.folder).good
    assert len(open_run(done.result.folder).samples()) > 100


@needs_posix("a limit on the size of a file")
def test_a_disk_that_stays_full_loses_nothing_that_was_written(project: Path) -> None:
    code = (
        "import resource, sys\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))\n"
        "from rigctl.cli.main import main\n"
        f"sys.argv = ['rigctl', 'simulate', {str(project / 'strokes.yaml')!r}, '--json']\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=project, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == ExitCode.FAILED, done.stderr
    told = json.loads(done.stdout)
    assert told["status"] == "failed"
    assert "cannot write" in told["reason"]
    assert "Traceback" not in done.stderr
    folder = Path(told["path"])
    assert verify(folder).good
    assert len(open_run(folder).samples()) > 300


def test_a_runs_folder_that_cannot_be_created_is_reported_before_anything_moves(project: Path) -> None:
    (project / "runs").write_text("", encoding="utf-8")
    done = rigctl(project, "simulate", "strokes.yaml")
    assert done.returncode == ExitCode.USAGE
    assert "cannot make a folder for the run" in done.stderr
    assert "runs" in done.stderr


# --- clock ---


def test_steps_of_the_calendar_clock_do_not_affect_a_run(
    do: Do, workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    jumps = iter([*range(0, 10**7, 3600)])
    real = time.time
    monkeypatch.setattr(time, "time", lambda: real() + (next(jumps) % 7200) - 3600)
    wall = [0.0]  # the monotonic clock, so that a busy machine does not affect the run either

    def sleep(seconds: float) -> None:
        wall[0] += seconds

    clock = ScaledClock(speed=20.0, monotonic=lambda: wall[0], sleep=sleep)
    backend = workshop.backend(workshop.rig(), clock=clock)
    done = do("steps:\n  - record: {name: a}\n    do:\n      - wait: 5 s\n", backend=backend)
    assert done.result.status == "finished"
    times = open_run(done.result.folder).samples()["time"]
    record = times[open_run(done.result.folder).samples()["record"] == 0]
    assert record.is_monotonic_increasing
    assert record.iloc[-1] - record.iloc[0] == pytest.approx(5.0, abs=0.05)


SLEPT_IN = {
    "a record that may be repeated": "record: {{name: a, retries: 2}}\n    do:\n      - wait: {wait}\n",
    "a wait": "wait: {wait}\n",
}


@pytest.mark.parametrize("counts", [False, True], ids=["Linux, macOS", "Windows"])
@pytest.mark.parametrize("step", SLEPT_IN.values(), ids=SLEPT_IN)
def test_a_run_on_a_computer_that_was_suspended_is_safe_first_and_says_so(
    step: str, counts: bool, do: Do, workshop: Workshop
) -> None:
    """On Windows the clock of a run goes on meanwhile: the wait in progress is over when it wakes."""
    wall, asleep = [0.0], [7200.0]  # it has been suspended before

    def sleep(seconds: float) -> None:
        wall[0] += seconds
        if wall[0] > 2.0 and asleep[0] == 7200.0:
            asleep[0] += 3600.0
            wall[0] += 3600.0 if counts else 0.0

    clock = ScaledClock(monotonic=lambda: wall[0], sleep=sleep, suspension=lambda: asleep[0])
    backend = workshop.backend(workshop.rig(), clock=clock)
    steps = f"steps:\n  - set: {{heater: on}}\n  - {step.format(wait='10 s')}  - set: {{heater: on}}\n"
    done = do(steps, backend=backend)
    assert (done.result.status, done.result.exit_code) == ("failed", ExitCode.FAILED)
    assert "the computer was suspended for 3.6e+03 s, and nobody watched the bench" in done.result.reason
    assert [value for _, value in done.commands("heater")] == [1.0, 0.0], "safe, and not on again"
    assert done.states == ["arming", "running", "safe", "finishing", "failed"]


def test_a_suspension_during_cleanup_makes_the_outputs_safe_and_cleanup_goes_on(
    do: Do, workshop: Workshop
) -> None:
    wall, asleep = [0.0], [0.0]

    def sleep(seconds: float) -> None:
        wall[0] += seconds
        asleep[0] = 60.0 if wall[0] > 5.0 else 0.0

    clock = ScaledClock(monotonic=lambda: wall[0], sleep=sleep, suspension=lambda: asleep[0])
    backend = workshop.backend(workshop.rig(), clock=clock)
    cleanup = "finally:\n  - set: {heater: on}\n  - wait: 4 s\n  - prompt: end of cleanup\n"
    done = do(f"steps:\n  - wait: 2 s\n{cleanup}", backend=backend)
    assert done.result.status == "finished"
    said = [event["message"] for event in done.log if "suspended" in event.get("message", "")]
    assert said == [
        "the computer was suspended for 60 s",
        "the computer was suspended for 60 s; cleanup goes on",
    ]
    assert [value for _, value in done.commands("heater")] == [1.0, 0.0]
    assert any(event.get("message") == "end of cleanup" for event in done.log)


# --- two runs, signals, kills ---


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    bench = RIG.read_text(encoding="utf-8").replace("model: hydraulic_cylinder", "")  # a plant made at once
    (tmp_path / "bench.yaml").write_text(no_silence(bench), encoding="utf-8")
    (tmp_path / "strokes.yaml").write_text(PROCEDURE, encoding="utf-8")
    (tmp_path / "long.yaml").write_text(LONG, encoding="utf-8")
    return tmp_path


def environment(project: Path) -> dict[str, str]:
    """The environment of commands, which keeps the user's own state folder out of the tests."""
    home = str(project / "home")
    return {**os.environ, **own_state(project / "home"), "HOME": home}


def rigctl(project: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rigctl", *arguments],
        cwd=project,
        env=environment(project),
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


class Background:
    """A `rigctl` command that runs in the background of the test."""

    def __init__(self, project: Path, *arguments: str) -> None:
        self.project = project
        self.known = set((project / "runs").glob("2*"))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "rigctl", *arguments],
            cwd=project,
            env=environment(project),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def state(self) -> dict[str, Any]:
        """The state in the run's heartbeat; empty until there is one."""
        for folder in set((self.project / "runs").glob("2*")) - self.known:
            try:
                found: dict[str, Any] = json.loads((folder / "state.json").read_text(encoding="utf-8"))
            except (OSError, ValueError):
                return {}
            return found
        return {}

    def wait_for(self, state: str) -> None:
        deadline = time.monotonic() + 600.0
        while self.state().get("state") != state:
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.02)

    def end(self) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=600)
        return self.process.returncode, out, err

    @property
    def folder(self) -> Path:
        (folder,) = set((self.project / "runs").glob("2*")) - self.known
        return folder


@pytest.fixture
def begin(project: Path) -> Iterator[Callable[..., Background]]:
    begun: list[Background] = []

    def make(*arguments: str) -> Background:
        begun.append(Background(project, *arguments))
        return begun[-1]

    yield make
    for run in begun:
        if run.process.poll() is None:
            run.process.kill()
            run.process.communicate()


@needs_signals
def test_a_second_run_on_a_rig_is_refused_and_the_first_can_be_aborted_elsewhere(
    project: Path, begin: Callable[..., Background]
) -> None:
    first = begin("run", "long.yaml", "--json")
    first.wait_for("running")
    second = rigctl(project, "run", "long.yaml")
    assert second.returncode == ExitCode.FAILED
    assert "'HL32 bench' is in use by a run of 'long'" in second.stderr
    assert "outputs are safe" in rigctl(project, "pause").stdout
    first.wait_for("paused")
    assert "goes on" in rigctl(project, "continue").stdout
    first.wait_for("running")
    assert "ending" in rigctl(project, "off", "--rig", "bench.yaml").stdout
    again = rigctl(project, "abort", "--json")
    assert "ending already" in json.loads(again.stdout)["answer"]
    for _ in range(2):  # two signals at once would be merged into one by the system
        first.process.send_signal(signal.SIGINT)
        time.sleep(0.5)
    code, out, _ = first.end()
    assert code == ExitCode.INTERRUPTED
    assert json.loads(out)["status"] == "aborted"
    assert rigctl(project, "run", "strokes.yaml", "--speed", "max").returncode == ExitCode.DONE


SIGNALS = [
    (name, code)
    for name, code in (("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 143))
    if hasattr(signal, name)
]


@needs_signals
@pytest.mark.parametrize(("name", "code"), SIGNALS)
def test_a_signal_ends_a_real_time_run_within_a_fraction_of_a_second(
    begin: Callable[..., Background], name: str, code: int
) -> None:
    run = begin("simulate", "long.yaml", "--speed", "1x", "--json")
    run.wait_for("running")
    run.process.send_signal(getattr(signal, name))
    run.wait_for("finishing")
    run.process.send_signal(getattr(signal, name))  # a second one skips the 30 s of the finally block
    returned, out, err = run.end()
    assert returned == code
    assert json.loads(out)["status"] == "aborted"
    assert "Traceback" not in err
    commands = [
        (event["value"], event["time"])
        for line in (run.folder / "log.jsonl").read_text(encoding="utf-8").splitlines()
        if (event := json.loads(line))["kind"] == "command" and event["actuator"] == "heater"
    ]
    assert [value for value, _ in commands] == [1.0, 0.0]
    assert verify(run.folder).good


@pytest.mark.parametrize("seed", range(3))
def test_a_run_killed_at_any_moment_is_recovered_and_can_be_resumed(
    begin: Callable[..., Background], seed: int
) -> None:
    run = begin("simulate", "strokes.yaml", "--speed", "1x")  # it lasts for half a minute
    run.wait_for("running")
    time.sleep(random.Random(seed).uniform(0.0, 6.0))
    run.process.kill()
    run.end()
    folder = run.folder
    assert verify(folder).good
    before = open_interrupted(folder)
    assert before.left + len(before.done.completed) == RECORDS
    how = Launch(
        runs=folder.parent,
        operator=AutomaticOperator(),
        backend="simulated",
        clock=VirtualClock(),
        exclusive=False,
    )
    result = relaunch(before, how)
    assert result.status == "finished", result.reason
    run_data = open_run(folder)
    outcomes = list(run_data.records["outcome"])
    assert outcomes.count("complete") == RECORDS
    assert len(outcomes) - RECORDS <= 1
    assert verify(folder).good
    with pytest.raises(RigctlError, match="finished"):
        open_interrupted(folder)
