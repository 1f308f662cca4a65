"""Work on a Dask cluster: a dead worker costs only its current piece, a dead scheduler no finished result."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.tasks import Workers, cluster, map_tasks, seed_of
from systems import needs_windows_itself
from tasks.pieces import slow

TESTS = Path(__file__).parent.parent


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers find the tests' functions."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("PYTHONWARNINGS", "ignore")


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A scheduler and a worker as separate processes; returns the scheduler's address and process."""
    python = [sys.executable, "-m", "dask"]
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show"]
    path = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(
        [*python, "scheduler", *options, "--scheduler-file", str(path)], text=True, **quiet
    ) as first:
        worker = [*python, "worker", "--scheduler-file", str(path), "--nthreads", "1", "--no-nanny"]
        with subprocess.Popen(
            [*worker, "--no-dashboard", "--death-timeout", "60"], text=True, **quiet
        ) as second:
            try:
                yield _address(path), first
            finally:
                for process in (second, first):
                    process.kill()


def _address(path: Path) -> str:
    import json
    import time

    give_up = time.monotonic() + 60
    while time.monotonic() < give_up:
        try:
            address: str = json.loads(path.read_text("utf-8"))["address"]
        except (OSError, ValueError):
            time.sleep(0.1)
        else:
            return address
    raise TimeoutError


@needs_windows_itself("worker processes of Dask that answer")
def test_killing_one_of_two_workers_loses_no_result(tmp_path: Path) -> None:
    found, killed = {}, None
    for index, result in map_tasks(partial(slow, str(tmp_path)), range(40), Workers(cluster="local:2")):
        found[index] = result
        if killed is None and len(found) == 6:
            pieces = (tmp_path / "begun").read_text("utf-8").split("\n")
            killed = int(pieces[-2].split()[1])
            os.kill(killed, 9)
    assert found == {piece: (piece, seed_of(7, "piece", piece)) for piece in range(40)}
    begun = [line.split() for line in (tmp_path / "begun").read_text("utf-8").splitlines()]
    again = len(begun) - 40
    assert 0 <= again <= 2  # only its current piece, and one that had just been finished there
    assert len({process for _, process in begun}) >= 2
    # the first four pieces go to both workers, so neither waits for the other
    assert len({process for piece, process in begun if int(piece) < 4}) == 2


@needs_windows_itself("worker processes of Dask that answer")
def test_a_dead_scheduler_is_reported_and_earlier_results_are_kept(
    tmp_path: Path, scheduler: tuple[str, subprocess.Popen[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "_PATIENCE", 60.0)
    address, process = scheduler
    found = []
    with pytest.raises(RigctlError, match="scheduler does not answer any more"):
        for index, _ in map_tasks(partial(slow, str(tmp_path)), range(4000), Workers(cluster=address)):
            found.append(index)
            if len(found) == 5:
                process.kill()
    assert 5 <= len(found) < 4000
    monkeypatch.setattr(cluster, "_PATIENCE", 1.0)
    with pytest.raises(RigctlError, match="no scheduler of a cluster answers"):
        list(map_tasks(partial(slow, str(tmp_path)), range(2), Workers(cluster=address)))
