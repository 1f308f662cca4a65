"""The processes that simulate an FMU: one for each core, each ended when a simulation takes too long."""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.child_process import module_command
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.regular import read_bytes
from rigctl.fmu.program import Program, digest, require_allowed
from rigctl.fmu.worker import read_message, write_message

Floats = NDArray[np.float64]

#: longest time of one simulation of a record, s, and of all those of one call
PATIENCE: Final = 60.0
MOST_SECONDS: Final = 3600.0


@dataclass(frozen=True)
class Job:
    """One simulation.

    Attributes
    ----------
    name: the record's, in messages.
    times: (n) increasing.
    drives: (n − 1, inputs) held from each time to the next, SI.
    jumps: (n − 1) whether an input jumps at the beginning of each.
    parameters: SI, by the program's parameters.
    starts: values of outputs at the start, SI, by the program's outputs; ignored where they cannot be set.
    """

    name: str
    times: Floats = field(repr=False)
    drives: Floats = field(repr=False)
    jumps: Floats = field(repr=False)
    parameters: Floats
    starts: Floats


@dataclass(frozen=True)
class Simulated:
    """(n, outputs) in SI, up to the point of a failure, and the `reason` of one; "" if there is none."""

    values: Floats
    reason: str


class Pool:
    """The processes of one program."""

    def __init__(self, program: Program, workers: int) -> None:
        require_allowed(program)
        self.program = program
        self.workers = workers
        self.seconds = 0.0  # of one simulation, the mean of the last call
        self._folder = Path(tempfile.mkdtemp(prefix="rigctl-fmu-"))
        self._fmu = self._folder / "model.fmu"
        # a private copy, so that what runs is what was allowed
        self._fmu.write_bytes(read_bytes(program.path))
        if digest(self._fmu) != program.sha256:
            raise RigctlError("the FMU has changed meanwhile", where=Location(program.path))
        self._idle: SimpleQueue[_Process | None] = SimpleQueue()
        self._all: list[_Process] = []
        for _ in range(workers):
            self._idle.put(None)
        self._count = 0
        self._threads = ThreadPoolExecutor(workers)
        atexit.register(self.close)

    def run(self, jobs: Sequence[Job]) -> list[Simulated]:
        """The results, in order.

        Raises
        ------
        RigctlError
            the FMU crashes, hangs or does not start; or all of them would take hours.
        """
        began = perf_counter()
        first = min(len(jobs), self.workers)
        results = list(self._threads.map(self._one, jobs[:first]))
        if first:
            each = (perf_counter() - began) / first
            expected = each * len(jobs)
            if expected > MOST_SECONDS:
                raise RigctlError(
                    f"{self.program.path.name} takes {each:.3g} s for one simulation of a record, and one "
                    f"step of a fit needs {len(jobs)} of them: {expected / 3600.0:.1f} h",
                    hint="Use fewer records ('--only'), fewer free parameters, or a faster FMU",
                )
        results += self._threads.map(self._one, jobs[first:])
        self.seconds = (perf_counter() - began) / max(len(jobs), 1)
        return results

    def close(self) -> None:
        """End the processes, and remove what was unpacked."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for one in self._all:
            one.end()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _one(self, job: Job) -> Simulated:
        process = self._idle.get()
        try:
            if process is None or process.ended:
                self._count += 1
                process = _Process(self.program, self._fmu, f"{os.getpid()}-{self._count}")
                self._all.append(process)
            return process.simulate(job)
        finally:
            self._idle.put(process)


class _Process:
    """One process, which simulates one job at a time."""

    def __init__(self, program: Program, fmu: Path, number: str) -> None:
        self._program = program
        self.ended = False
        self._late = False
        self._child = subprocess.Popen(
            module_command("rigctl.fmu.worker"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=fmu.parent,
        )
        self._starts = [k for k, one in enumerate(program.starts) if one is not None]
        ports = [*program.parameters, *(one for one in program.starts if one is not None)]
        setup = {
            "fmu": str(fmu),
            "number": number,
            "kind": program.kind,
            "inputs": [one.reference for one in program.inputs],
            "outputs": [one.reference for one in program.outputs],
            "parameters": [one.reference for one in ports],
        }
        self._factors, self._offsets = (np.array([getattr(one, key) for one in ports]) for key in _LINE)
        self._in = [np.array([getattr(one, key) for one in program.inputs]) for key in _LINE]
        self._out = [np.array([getattr(one, key) for one in program.outputs]) for key in _LINE]
        self._exchange("its start", setup)

    def simulate(self, job: Job) -> Simulated:
        """Run one simulation."""
        values = (np.concatenate([job.parameters, job.starts[self._starts]]) - self._offsets) / self._factors
        drives = (job.drives - self._in[1]) / self._in[0] if job.drives.size else job.drives
        content, (found,) = self._exchange(
            f"record {job.name}{_with(self._program, job)}", {}, job.times, drives, job.jumps, values
        )
        found = found * self._out[0] + self._out[1]
        reason = str(content["reason"])
        if not reason and not np.isfinite(found).all():
            at = int(np.argmin(np.isfinite(found).all(axis=1)))
            name = self._program.outputs[int(np.argmin(np.isfinite(found[at])))].name
            reason = f"{name} is not a number"
        return Simulated(found, reason and f"{self._program.path.name}: {reason}{_with(self._program, job)}")

    def end(self) -> None:
        """End the process."""
        self.ended = True
        with suppress(OSError):
            self._child.kill()
        self._child.wait()
        for stream in (self._child.stdin, self._child.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()

    def _exchange(self, what: str, content: dict[str, object], *arrays: Floats) -> tuple[dict, list[Floats]]:  # type: ignore[type-arg]
        assert self._child.stdin is not None  # noqa: S101 - it is a pipe
        assert self._child.stdout is not None  # noqa: S101
        timer = threading.Timer(PATIENCE, self._too_late)
        timer.daemon = True
        timer.start()
        try:
            write_message(self._child.stdin, content, *arrays)  # type: ignore[arg-type]
            answer = read_message(self._child.stdout)  # type: ignore[arg-type]
        except OSError:
            answer = None
        finally:
            timer.cancel()
        if answer is None:
            self.end()
            how = f"did not return within {PATIENCE:.0f} s" if self._late else "has crashed"
            raise RigctlError(
                f"the FMU {how}",
                where=Location(self._program.path),
                value=what,
                exit_code=ExitCode.FAILED,
            )
        return answer

    def _too_late(self) -> None:
        self._late = True
        self._child.kill()


_LINE = ("factor", "offset")


def _with(program: Program, job: Job) -> str:
    """The parameters of a job, for a message."""
    pairs = zip(program.parameters, job.parameters.tolist(), strict=True)
    shown = ", ".join(f"{one.name} = {value:.6g}" for one, value in pairs)
    return f" with {shown} (SI)" if shown else ""


_pools: dict[tuple[int, Program], Pool] = {}
_opening = threading.Lock()


def pool_of(program: Program) -> Pool:
    """The processes of a program, started when first needed.

    Raises
    ------
    RigctlError
        the user has not named the FMU, or it has changed.
    """
    with _opening:
        key = os.getpid(), program
        if key not in _pools:
            _pools[key] = Pool(program, max(1, min(os.cpu_count() or 1, 8)))
        return _pools[key]
