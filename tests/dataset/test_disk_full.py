"""A disk with a limit, in a separate program: the error is clear and measured data are kept."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigctl.dataset import open_run, verify
from systems import needs_posix

TESTS = Path(__file__).parents[1]
PROGRAM = """
import resource, signal, sys
from pathlib import Path
from dataset.strokes import LAYOUT, STARTED, sample
from rigctl.dataset import RunHeader, RunWriter, Source
from rigctl.errors import RigctlError

header = RunHeader("20261121-093000-stroke", Source("stroke"), Source("bench"), LAYOUT, STARTED)
writer = RunWriter.create(Path(sys.argv[1]), header)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
writer.open_record(0.0, "stroke", {}, "1", 100.0)
try:
    for row in range(1000000):
        writer.append(sample(float(row), 0))
        if row % 10 == 0:
            writer.flush()
except RigctlError as problem:
    print(row, int(problem.exit_code))
try:
    writer.close("failed", "disk full")
except RigctlError as problem:
    print("close", int(problem.exit_code))
"""


@needs_posix("a limit on the size of a file")
@pytest.mark.parametrize("limit", [2000, 5000, 40_000, 1_000_000])
def test_samples_written_before_the_disk_was_full_are_kept(tmp_path: Path, limit: int) -> None:
    answer = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path / "runs"), str(limit)],
        env={**os.environ, "PYTHONPATH": str(TESTS)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stderr == ""
    failed = [line.split() for line in answer.stdout.splitlines()]
    assert failed[0][1] == "1"
    assert failed[1] == ["close", "1"]
    (folder,) = (tmp_path / "runs").iterdir()
    assert verify(folder).condition.value == "recovered"
    times = open_run(folder).signals("time")
    assert np.array_equal(times, np.arange(len(times)))
    assert len(times) > int(failed[0][0]) - 20
