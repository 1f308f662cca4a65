"""The process that simulates an FMU, ended when a simulation takes too long."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from rigctl.child_process import module_command
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.fmu.description import Description, Port
from rigctl.json_values import parse_json

Floats = NDArray[np.float64]

#: longest time of one simulation by default, and in any case that of the start with its imports, s
PATIENCE: Final = 60.0
#: interval at which Ctrl-C is looked for, s
_LOOK: Final = 0.2


class FmuProcess:
    """A process that simulates one FMU, and the folder in which it is unpacked; a context.

    Parameters
    ----------
    inputs, outputs: names of the variables that are connected.
    starts: names of those that are set before a simulation.
    patience: longest time of one simulation, s.
    slow: what to do if that is too short.
    """

    def __init__(
        self,
        about: Description,
        inputs: Sequence[str],
        outputs: Sequence[str],
        starts: Sequence[str],
        *,
        patience: float = PATIENCE,
        slow: str = "",
    ) -> None:
        self._about, self._patience, self._slow = about, patience, slow
        self._inputs, self._outputs, self._starts = (
            [about.port(name) for name in names] for names in (inputs, outputs, starts)
        )
        self._answers: SimpleQueue[bytes] = SimpleQueue()

    def __enter__(self) -> Self:
        self._folder = TemporaryDirectory(prefix="rigctl-fmu-", ignore_cleanup_errors=True)
        self._child = subprocess.Popen(  # noqa: S603 - the user has named this FMU to be run
            module_command("rigctl.fmu.worker"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._reader = threading.Thread(target=self._read_answers, daemon=True)
        self._reader.start()
        setup = {
            "fmu": str(self._about.path.resolve()),
            "folder": str(Path(self._folder.name) / "unpacked"),
            "kind": self._about.kind,
            "inputs": [one.reference for one in self._inputs],
            "outputs": [one.reference for one in self._outputs],
            "names": [one.name for one in self._outputs],
        }
        try:
            answer = self._ask(setup, "been loaded", max(self._patience, PATIENCE))
            if "reason" in answer:
                raise self._error(f"the FMU does not start: {answer['reason']}")
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._child.kill()
        self._child.wait()
        self._reader.join()
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
        job = {
            "points": points.tolist(),
            "drives": _written(self._inputs, drives).tolist(),
            "starts": {
                one.reference: (starts[one.name] - one.offset) / one.factor
                for one in self._starts
                if one.name in starts
            },
        }
        answer = self._ask(job, f"finished {which}", self._patience)
        if "reason" in answer:
            raise RigctlError(
                f"the FMU failed in {where} at {answer['reason']}", where=Location(self._about.path)
            )
        rows = np.asarray(answer["rows"], dtype=np.float64).reshape(len(points), len(self._outputs))
        factors, offsets = _scale(self._outputs)
        return np.asarray(rows * factors + offsets)

    def _ask(self, command: Mapping[str, Any], what: str, patience: float) -> dict[str, Any]:
        """The answer to a command.

        Raises
        ------
        RigctlError
            the process ends, or needs longer than `patience` s.
        """
        assert self._child.stdin is not None  # noqa: S101 - it is a pipe
        with suppress(OSError):  # it has ended: so do its answers
            self._child.stdin.write(json.dumps(command).encode() + b"\n")
            self._child.stdin.flush()
        latest = time.monotonic() + patience
        while time.monotonic() < latest:
            with suppress(Empty):
                line = self._answers.get(timeout=_LOOK)
                if not line:
                    raise self._error(f"the FMU has crashed (exit code {self._child.wait()})")
                answer: dict[str, Any] = parse_json(line)
                return answer
        raise self._error(f"the FMU has not {what} in {patience:g} s", self._slow)

    def _error(self, what: str, hint: str = "") -> RigctlError:
        return RigctlError(
            what, where=Location(self._about.path), hint=hint or None, exit_code=ExitCode.FAILED
        )

    def _read_answers(self) -> None:
        """Forward the lines of the process, b"" at their end; in a thread, because reading one blocks."""
        for line in self._child.stdout or ():
            self._answers.put(line)
        self._answers.put(b"")


def _scale(ports: Sequence[Port]) -> tuple[Floats, Floats]:
    return np.array([one.factor for one in ports]), np.array([one.offset for one in ports])


def _written(ports: Sequence[Port], values: Floats) -> Floats:
    """SI values in the FMU's units."""
    factors, offsets = _scale(ports)
    return np.asarray((values - offsets) / factors)
