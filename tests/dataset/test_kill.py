"""A kill at any moment, or no memory left: at most a second of samples is lost, and never the folder."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path
from time import sleep

import numpy as np
import pytest

from dataset import endless_writer
from rigctl.dataset import open_run, verify

TESTS = Path(__file__).parents[1]


@pytest.mark.parametrize("seed", range(6))
def test_a_kill_loses_at_most_the_last_second_of_samples(tmp_path: Path, seed: int) -> None:
    chance = random.Random(seed)
    program = [sys.executable, str(endless_writer.__file__), str(tmp_path / "runs"), str(seed)]
    environment = {**os.environ, "PYTHONPATH": str(TESTS)}
    said = tmp_path / "said"
    with said.open("wb") as out, subprocess.Popen(program, stdout=out, env=environment) as process:
        while not said.stat().st_size:
            sleep(0.01)
        sleep(chance.uniform(0.0, 1.6))
        process.kill()
    lines = said.read_text(encoding="utf-8").splitlines()
    folder = Path(lines[0])
    printed = [line.split() for line in lines[1:-1]]
    alive = max((float(when) for _, when in printed), default=0.0)  # a busy computer stops it before that
    due = max((int(count) for count, when in printed if float(when) < alive - 1.0), default=-1)

    verdict = verify(folder)
    assert verdict.condition.value == "recovered", verdict
    assert verify(folder).condition.value == "whole"
    run = open_run(folder)
    times = run.signals("time")
    assert np.array_equal(times, np.arange(len(times)))  # none missing, none duplicated
    assert len(times) > due
    outcomes = run.records["outcome"].tolist()
    assert outcomes[:-1] == ["complete"] * (len(outcomes) - 1)
    for index in run.usable:
        record = run.record(index)
        assert (record.start, record.end) == (record.time[0], record.time[-1] + 1.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_folder_is_created_atomically_despite_kills(tmp_path: Path, seed: int) -> None:
    runs = tmp_path / "runs"
    program = [sys.executable, str(endless_writer.__file__), str(runs), str(seed)]
    with subprocess.Popen(
        program, stdout=subprocess.DEVNULL, env={**os.environ, "PYTHONPATH": str(TESTS)}
    ) as process:
        while not runs.exists():
            sleep(0.0005)
        sleep(0.0015 * seed)
        process.kill()
    for folder in runs.iterdir():
        if not folder.name.startswith("."):
            assert verify(folder).good
            assert open_run(folder).info["status"] == "interrupted"


@pytest.mark.skipif(sys.platform != "linux", reason="the limit of memory is read from /proc")
@pytest.mark.parametrize("left", [1_000_000, 60_000_000])
def test_without_memory_a_run_is_reported_and_completed_later(tmp_path: Path, left: int) -> None:
    from dataset import short_of_memory

    program = [sys.executable, str(short_of_memory.__file__), str(tmp_path / "runs"), str(left)]
    environment = {**os.environ, "PYTHONPATH": str(TESTS)}
    done = subprocess.run(program, capture_output=True, text=True, env=environment, check=False, timeout=600)
    assert (done.returncode, "Traceback" in done.stderr) == (1, False), done.stderr
    assert "rigctl runs verify 20261121-093000-stroke" in done.stdout
    folder = tmp_path / "runs" / "20261121-093000-stroke"
    assert verify(folder).condition.value == "recovered"
    assert len(open_run(folder).signals("time")) == short_of_memory.ROWS
