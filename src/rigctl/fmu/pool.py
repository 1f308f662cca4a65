"""The processes that simulate the FMU of a model: one for each core, which stay for the whole command.

In: jobs, one simulation of one record with one set of parameters each. Out: their outputs, in order. An FMU
gives no derivatives, so a fit takes differences: each of its steps simulates every record once for every
free parameter. Each process imports and loads the FMU once, hence processes that stay; and differences of an
FMU that is not deterministic would be noise, hence the check of the first job.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.regular import read_bytes
from rigctl.fmu.process import PATIENCE, FmuProcess
from rigctl.fmu.program import Program, digest, require_allowed

Floats = NDArray[np.float64]

#: longest time that all simulations of one call may be expected to take, s
_MOST_SECONDS: Final = 3600.0
#: the most processes
_MOST: Final = 8


@dataclass(frozen=True)
class Job:
    """One simulation.

    Attributes
    ----------
    name: the record's, in messages.
    points: (n) increasing, s.
    drives: (n − 1, inputs) held from each point to the next, SI.
    parameters: SI, by the program's parameters.
    starts: values of outputs at the start, SI, by the program's outputs; ignored where they cannot be set.
    """

    name: str
    points: Floats = field(repr=False)
    drives: Floats = field(repr=False)
    parameters: Floats
    starts: Floats


@dataclass(frozen=True)
class Simulated:
    """(n, outputs) in SI, NaN from a failure on, and the `reason` of one; "" if there is none."""

    values: Floats
    reason: str


class Pool:
    """The processes of one program.

    Parameters
    ----------
    workers: number of processes.
    patience: longest time of one simulation, s.
    """

    def __init__(self, program: Program, workers: int, patience: float = PATIENCE) -> None:
        require_allowed(program)
        self._program, self._workers, self._patience = program, workers, patience
        self._folder = Path(tempfile.mkdtemp(prefix="rigctl-fmu-"))
        self._fmu = self._folder / program.path.name
        # a private copy, so that what runs is what was allowed
        self._fmu.write_bytes(read_bytes(program.path))
        if digest(self._fmu) != program.sha256:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise RigctlError("the FMU has changed meanwhile", where=Location(program.path))
        self._settable = [k for k, port in enumerate(program.starts.values()) if port is not None]
        self._idle: SimpleQueue[FmuProcess | None] = SimpleQueue()
        for _ in range(workers):
            self._idle.put(None)
        self._started: list[FmuProcess] = []
        self._threads = ThreadPoolExecutor(workers)
        self._steady = False
        atexit.register(self.close)

    def run(self, jobs: Sequence[Job]) -> list[Simulated]:
        """The results, in order.

        Raises
        ------
        RigctlError
            the FMU crashes, hangs or does not start, all simulations would take hours, or the first one has
            another result when it is repeated.
        """
        if not jobs:
            return []
        began = perf_counter()
        try:
            # The first job alone: it tells whether the FMU is deterministic and, by its time, whether all
            # jobs together would take hours. Only then are the others dealt out, every n-th one to a process.
            first = self._each(jobs[:1])[0] if self._steady else self._twice(jobs[0])
            self._require_time(perf_counter() - began, len(jobs))
            rest = jobs[1:]
            parts = [rest[k :: self._workers] for k in range(min(self._workers, len(rest)))]
            found: list[Simulated] = [first] * len(jobs)
            for k, part in enumerate(self._threads.map(self._each, parts)):
                found[1 + k :: self._workers] = part
            return found
        except BaseException:
            self.close()  # the other threads wait for answers
            raise

    def close(self) -> None:
        """End the processes, and remove what was unpacked."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for one in self._started:
            one.__exit__(None, None, None)
        self._started.clear()
        shutil.rmtree(self._folder, ignore_errors=True)
        atexit.unregister(self.close)
        _forget(self)

    def _each(self, jobs: Sequence[Job]) -> list[Simulated]:
        """The results of jobs in one process, which has the next one before it has answered the last."""
        process = self._idle.get()
        try:
            if process is None:
                process = self._new()
            # All requests are sent before the first result is awaited, so that the process is never idle
            # between two simulations.
            for job in jobs:
                starts = np.concatenate([job.parameters, job.starts[self._settable]])
                process.request(job.points, job.drives, starts)
            return [self._result(process, job) for job in jobs]
        finally:
            self._idle.put(process)

    def _result(self, process: FmuProcess, job: Job) -> Simulated:
        reason, rows = process.result(f"the simulation of {job.name}{_with(self._program, job)}")
        if reason:
            reason = f"{self._program.path.name} failed at {reason}{_with(self._program, job)}"
        return Simulated(rows, reason)

    def _new(self) -> FmuProcess:
        program = self._program
        process = FmuProcess(
            self._fmu,
            program.kind,
            list(program.inputs.values()),
            list(program.outputs.values()),
            [*program.parameters.values(), *(one for one in program.starts.values() if one is not None)],
            patience=self._patience,
            named=program.path,
        )
        process.__enter__()
        self._started.append(process)
        return process

    def _twice(self, job: Job) -> Simulated:
        """The result of a job, which is done twice by one process.

        An FMU that remembers other simulations, or has noise, would have arbitrary derivatives.

        Raises
        ------
        RigctlError
            the results differ.
        """
        first, again = self._each([job, job])
        if not np.array_equal(first.values, again.values, equal_nan=True):
            raise RigctlError(
                f"the FMU gives two results for one simulation of {job.name}",
                where=Location(self._program.path),
                expected="the same, as a model without noise or memory of another simulation does",
                exit_code=ExitCode.FAILED,
            )
        self._steady = True
        return first

    def _require_time(self, seconds: float, count: int) -> None:
        """Refuse what would take hours.

        Raises
        ------
        RigctlError
            it would.
        """
        expected = seconds * count / self._workers
        if expected > _MOST_SECONDS:
            raise RigctlError(
                f"one simulation of a record takes {seconds:.3g} s, and one step of a fit needs {count} of "
                f"them: {expected / 3600.0:.1f} h",
                where=Location(self._program.path),
                hint="Use fewer records ('--only'), fewer free parameters, or a faster FMU",
            )


def _with(program: Program, job: Job) -> str:
    """The parameters of a job, for a message."""
    pairs = zip(program.parameters, job.parameters.tolist(), strict=True)
    shown = ", ".join(f"{name} = {value:.6g}" for name, value in pairs)
    return f" with {shown} (SI)" if shown else ""


_pools: dict[tuple[int, str], Pool] = {}
_opening = threading.Lock()


def pool_of(program: Program) -> Pool:
    """The processes of a program, started when first needed.

    Raises
    ------
    RigctlError
        the user has not named the FMU, or it has changed.
    """
    with _opening:
        key = os.getpid(), repr(program)  # a forked process has none of its parent's
        if key not in _pools:
            _pools[key] = Pool(program, max(1, min(os.cpu_count() or 1, _MOST)))
        return _pools[key]


def _forget(closed: Pool) -> None:
    for key in [key for key, pool in _pools.items() if pool is closed]:
        del _pools[key]
