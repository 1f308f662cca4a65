"""The process that simulates an FMU, ended when a simulation takes too long.

In: an FMU, its connected variables, and simulations in SI. Out: rows of outputs in SI, or when and why it
failed. This is the side of rigctl; the other side is `rigctl.fmu.worker`. An FMU is foreign compiled code,
which may crash or hang: the loss is then one process, and the error says of which simulation.
"""

from __future__ import annotations

import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Final, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl.child_process import module_command
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.fmu.description import Kind, Port
from rigctl.fmu.worker import read_message, write_message

Floats = NDArray[np.float64]

#: longest time of one simulation by default, and in any case that of the start with its imports, s
PATIENCE: Final = 60.0
#: why a simulation failed, and its rows
_Answer: TypeAlias = tuple[str, list[Floats]]
#: interval at which Ctrl-C is looked for, s
_LOOK: Final = 0.2


class FmuProcess:
    """A process that simulates one FMU, and the folder in which it is unpacked; a context.

    Parameters
    ----------
    path, kind: of the FMU, and how it is simulated.
    inputs, outputs: the variables that are connected.
    starts: those that are set before a simulation.
    patience: longest time of one simulation, s.
    slow: what to do if that is too short.
    named: the path in messages, if `path` is a copy.
    """

    def __init__(
        self,
        path: Path,
        kind: Kind,
        inputs: Sequence[Port],
        outputs: Sequence[Port],
        starts: Sequence[Port],
        *,
        patience: float = PATIENCE,
        slow: str = "",
        named: Path | None = None,
    ) -> None:
        self._path, self._kind, self._patience, self._slow = path, kind, patience, slow
        self._named = named or path
        self._inputs, self._outputs, self._starts = inputs, outputs, starts
        self._of_inputs, self._of_outputs, self._of_starts = map(_scale, (inputs, outputs, starts))
        self._requests: SimpleQueue[tuple[Mapping[str, Any], tuple[Floats, ...]] | None] = SimpleQueue()
        self._answers: SimpleQueue[_Answer | None] = SimpleQueue()

    def __enter__(self) -> Self:
        self._folder = TemporaryDirectory(prefix="rigctl-fmu-", ignore_cleanup_errors=True)
        self._child = subprocess.Popen(  # noqa: S603 - the user has named this FMU to be run
            module_command("rigctl.fmu.worker"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._threads = [
            threading.Thread(target=forward, daemon=True)
            for forward in (self._read_answers, self._write_requests)
        ]
        for thread in self._threads:
            thread.start()
        setup = {
            "fmu": str(self._path.resolve()),
            "folder": str(Path(self._folder.name) / "unpacked"),
            "kind": self._kind,
            "inputs": [one.reference for one in self._inputs],
            "outputs": [one.reference for one in self._outputs],
            "starts": [one.reference for one in self._starts],
            "names": [one.name for one in self._outputs],
        }
        try:
            self._send(setup)
            reason, _ = self._answer("been loaded", max(self._patience, PATIENCE))
            if reason:
                raise self._error(f"the FMU does not start: {reason}")
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # Killed, not asked to end: it may hang in the FMU's code. Its end closes the pipes, on which both
        # threads return.
        self._child.kill()
        self._child.wait()
        self._requests.put(None)
        for thread in self._threads:
            thread.join()
        for stream in (self._child.stdin, self._child.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        self._folder.cleanup()

    def simulate(
        self, where: str, which: str, points: Floats, drives: Floats, starts: Mapping[str, float]
    ) -> Floats:
        """The outputs at each point in time, SI: (points, outputs).

        Parameters
        ----------
        where, which: the record and the simulation, for messages.
        points: (n) s, increasing.
        drives: (n, inputs) held from each point to the next, SI.
        starts: by variable, what is set before it begins, SI.

        Raises
        ------
        RigctlError
            the FMU fails, returns what is no finite number, crashes, or does not return in time.
        """
        values = np.array([starts.get(one.name, np.nan) for one in self._starts], dtype=np.float64)
        reason, rows = self.attempt(which, points, drives, values)
        if reason:
            raise RigctlError(f"the FMU failed in {where} at {reason}", where=Location(self._named))
        return rows

    def attempt(self, which: str, points: Floats, drives: Floats, starts: Floats) -> tuple[str, Floats]:
        """When and why the FMU fails, "" if it does not, and its outputs until then, NaN from there on.

        Parameters
        ----------
        starts: in the order of the variables that are set; NaN where the FMU's own value is to hold.

        Raises
        ------
        RigctlError
            the FMU crashes, or does not return in time.
        """
        self.request(points, drives, starts)
        return self.result(which)

    def request(self, points: Floats, drives: Floats, starts: Floats) -> None:
        """Ask for a simulation as `attempt` does; several may be asked for before the first result."""
        self._send({}, points, _written(self._of_inputs, drives), _written(self._of_starts, starts))

    def result(self, which: str) -> tuple[str, Floats]:
        """The next result, as of `attempt`."""
        reason, rows = self._answer(f"finished {which}", self._patience)
        factors, offsets = self._of_outputs
        return reason, np.asarray(rows[0] * factors + offsets)

    def _send(self, command: Mapping[str, Any], *arrays: Floats) -> None:
        self._requests.put((command, arrays))

    def _answer(self, what: str, patience: float) -> _Answer:
        """The next answer.

        Raises
        ------
        RigctlError
            the process ends, or needs longer than `patience` s.
        """
        # A blocking read could not be interrupted, neither by the deadline nor by Ctrl-C; the answers come
        # through a queue instead, which is looked at in short intervals.
        latest = time.monotonic() + patience
        while time.monotonic() < latest:
            with suppress(Empty):
                answer = self._answers.get(timeout=_LOOK)
                if answer is None:
                    raise self._error(f"the FMU has crashed (exit code {self._child.wait()})")
                return answer
        raise self._error(f"the FMU has not {what} in {patience:g} s", self._slow)

    def _error(self, what: str, hint: str = "") -> RigctlError:
        return RigctlError(what, where=Location(self._named), hint=hint or None, exit_code=ExitCode.FAILED)

    def _write_requests(self) -> None:
        """Send the requests; in a thread, because an FMU that hangs leaves the pipe full, and only who waits
        for its answer knows how long that may take."""
        assert self._child.stdin is not None  # noqa: S101 - it is a pipe
        while (request := self._requests.get()) is not None:
            command, arrays = request
            with suppress(OSError):  # it has ended: so do its answers
                write_message(self._child.stdin, command, *arrays)

    def _read_answers(self) -> None:
        """Forward the answers of the process, None at their end; in a thread, because reading one blocks."""
        assert self._child.stdout is not None  # noqa: S101 - it is a pipe
        while (message := read_message(self._child.stdout)) is not None:
            self._answers.put((str(message[0]["reason"]), message[1]))
        self._answers.put(None)


def _scale(ports: Sequence[Port]) -> tuple[Floats, Floats]:
    return np.array([one.factor for one in ports]), np.array([one.offset for one in ports])


def _written(scale: tuple[Floats, Floats], values: Floats) -> Floats:
    """SI values in the FMU's units."""
    factors, offsets = scale
    return np.asarray((values - offsets) / factors)
