"""The processes that simulate the FMU of a model: what an FMU may do to the command that uses it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from foreign_fmus import ACCELERATION, motor_fmu
from rigctl.errors import RigctlError
from rigctl.fmu.archive import digest
from rigctl.fmu.description import read_description
from rigctl.fmu.program import FmuProgram
from rigctl.foreign.pool import Job, Pool
from systems import needs_compiler

pytestmark = needs_compiler


@contextmanager
def pool(path: Path, workers: int = 2, patience: float = 60.0) -> Iterator[Pool]:
    about = read_description(path)
    program = FmuProgram(
        path,
        digest(path),
        about.kind,
        inputs={"voltage": about.port("voltage")},
        outputs={"speed": about.port("speed")},
        parameters={"kt": about.port("k")},
        sizes={"kt": 0.05},
        starts={"speed": about.port("speed")},
    )
    program.allow()
    made = Pool(program, workers, patience)
    try:
        yield made
    finally:
        made.close()


def job(kt: float, start: float = 0.0, count: int = 20) -> Job:
    return Job(
        "one", 0.01 * np.arange(count + 1), np.full((count, 1), 6.0), np.array([kt]), np.array([start])
    )


def test_results_are_in_the_order_of_the_jobs_however_they_are_shared(tmp_path: Path) -> None:
    fmu = motor_fmu(tmp_path / "motor.fmu")
    jobs = [job(0.03 + 0.002 * k, float(k)) for k in range(7)]
    with pool(fmu, 1) as alone, pool(fmu, 3) as shared:
        expected, found = alone.run(jobs), shared.run(jobs)
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
    assert [one.values[0, 0] for one in found] == [float(k) for k in range(7)]


@pytest.mark.parametrize("count", [20, 20_000], ids=["in the pipe", "more than a pipe holds"])
def test_an_fmu_that_hangs_ends_the_work_in_one_message(tmp_path: Path, count: int) -> None:
    hanging = f"m->k > 0.04 ? loop() : {ACCELERATION}"
    with pool(motor_fmu(tmp_path / "motor.fmu", acceleration=hanging), 1, patience=2.0) as processes:
        processes.run([job(0.03)])
        with pytest.raises(
            RigctlError, match=r"motor\.fmu: the FMU has not finished .* kt = 0\.05 .* in 2 s"
        ):
            processes.run([job(0.03), job(0.05), job(0.03, count=count), job(0.03, count=count)])


def test_an_fmu_with_a_memory_of_other_simulations_is_refused(tmp_path: Path) -> None:
    remembering = f"({ACCELERATION}) + (going += 1)"
    fmu = motor_fmu(tmp_path / "motor.fmu", acceleration=remembering)
    with pool(fmu) as processes, pytest.raises(RigctlError, match="two results for one simulation"):
        processes.run([job(0.05)])


def test_an_fmu_that_has_been_exchanged_since_it_was_named_is_not_run(tmp_path: Path) -> None:
    fmu = motor_fmu(tmp_path / "motor.fmu")
    with pool(fmu) as processes:
        program = processes._program
    motor_fmu(fmu, acceleration="0.0")
    with pytest.raises(RigctlError, match="the FMU has changed meanwhile"):
        Pool(program, 1).run([job(0.05)])
