"""The processes that simulate the program of a model: one for each core, which stay for the whole command.

In: jobs, one simulation of one record with one set of parameters each. Out: their outputs, in order. A
program gives no derivatives, so a fit takes differences: each of its steps simulates every record once for
every free parameter. Each process imports and loads the program once, hence processes that stay; and
differences of a program that is not deterministic would be noise, hence the check of the first job.
"""

from __future__ import annotations

import atexit
import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from queue import SimpleQueue
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import ExitCode, RigctlError
from rigctl.foreign.process import ProgramProcess
from rigctl.foreign.program import Program

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
    drives: (n − 1, inputs) held from each point to the next, SI; or with the tunable parameters.
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
    patience: longest time of one simulation, s; by default the program's own.
    """

    def __init__(self, program: Program, workers: int, patience: float | None = None) -> None:
        program.require_allowed()
        self._program, self._workers, self._patience = program, workers, patience
        self._settable = [k for k, name in enumerate(program.outputs) if name in program.settable]
        self._idle: SimpleQueue[ProgramProcess | None] = SimpleQueue()
        for _ in range(workers):
            self._idle.put(None)
        self._started: list[ProgramProcess] = []
        self._threads = ThreadPoolExecutor(workers)
        self._steady = False
        atexit.register(self.close)

    def run(self, jobs: Sequence[Job]) -> list[Simulated]:
        """The results, in order.

        Raises
        ------
        RigctlError
            the program crashes, hangs or does not start, all simulations would take hours, or the first one
            has another result when it is repeated.
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
        """End the processes."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for one in self._started:
            one.__exit__(None, None, None)
        self._started.clear()
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

    def _result(self, process: ProgramProcess, job: Job) -> Simulated:
        reason, rows = process.result(f"the simulation of {job.name}{_with(self._program, job)}")
        if reason:
            reason = f"{self._program.name} failed at {reason}{_with(self._program, job)}"
        return Simulated(rows, reason)

    def _new(self) -> ProgramProcess:
        process = self._program.process(self._patience)
        process.__enter__()
        self._started.append(process)
        return process

    def once(self, job: Job) -> Simulated:
        """The result of a first job, on which the others do not depend.

        Raises
        ------
        RigctlError
            the program refuses it, crashes, hangs or does not start.
        """
        try:
            return self._each([job])[0]
        except BaseException:
            self.close()
            raise

    def _twice(self, job: Job) -> Simulated:
        """The result of a job, which is done twice by one process.

        A program that remembers other simulations, or has noise, would have arbitrary derivatives.

        Raises
        ------
        RigctlError
            the results differ.
        """
        program = self._program
        first, again = self._each([job, job])
        if not np.array_equal(first.values, again.values, equal_nan=True):
            raise RigctlError(
                f"there are two results for one simulation of {job.name} by {program.noun}",
                where=program.location,
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
                where=self._program.location,
                hint="Use fewer records ('--only') or fewer free parameters, or make it faster",
            )


def _with(program: Program, job: Job) -> str:
    """The parameters of a job, for a message; of those that change, from where to where."""
    values = {
        name: f"{value:.6g}" for name, value in zip(program.parameters, job.parameters.tolist(), strict=True)
    }
    changing = job.drives[:, len(program.inputs) :]
    for name, course in zip(program.tunable, changing.T, strict=False):
        if np.ptp(course):
            values[name] = f"{course.min():.6g} to {course.max():.6g}"
        else:
            values[name] = f"{course[0]:.6g}"
    shown = ", ".join(f"{name} = {value}" for name, value in values.items())
    return f" with {shown} (SI)" if shown else ""


_pools: dict[tuple[int, str], Pool] = {}
_opening = threading.Lock()


def pool_of(program: Program) -> Pool:
    """The processes of a program, started when first needed.

    Raises
    ------
    RigctlError
        the user has not asked for it to be run.
    """
    with _opening:
        key = os.getpid(), repr(program)  # a forked process has none of its parent's
        if key not in _pools:
            _pools[key] = Pool(program, max(1, min(os.cpu_count() or 1, _MOST)))
        return _pools[key]


def _forget(closed: Pool) -> None:
    for key in [key for key, pool in _pools.items() if pool is closed]:
        del _pools[key]
