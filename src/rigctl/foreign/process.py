"""The process that simulates a program, ended when a simulation takes too long.

In: a program, and simulations. Out: rows of outputs, or when and why it failed. This is the side of rigctl; a
program is foreign code, which may crash or hang: the loss is then one process, and the error says of which
simulation.
"""

from __future__ import annotations

import subprocess
import threading
import time
from collections.abc import Mapping
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
from rigctl.foreign.messages import read_message, write_message

Floats = NDArray[np.float64]

#: longest time of one simulation by default, and in any case that of the start with its imports, s
PATIENCE: Final = 60.0
#: a message of the process: the reason of a failure and more, and its arrays
_Answer: TypeAlias = tuple[dict[str, Any], list[Floats]]
#: interval at which Ctrl-C is looked for, s
_LOOK: Final = 0.2


class ProgramProcess:
    """A process that simulates one program, with a folder of its own; a context.

    Parameters
    ----------
    module: is run; it answers the first message with why it cannot begin, each further one with a simulation.
    noun: what the program is, in messages: "the FMU".
    patience: longest time of one simulation, s.
    slow: what to do if that is too short.
    where: the file in messages, if there is one.
    """

    def __init__(
        self, module: str, noun: str, patience: float, slow: str = "", where: Location | None = None
    ) -> None:
        self._module, self._noun, self._patience, self._slow = module, noun, patience, slow
        self._where = where
        self._requests: SimpleQueue[tuple[Mapping[str, Any], tuple[Floats, ...]] | None] = SimpleQueue()
        self._answers: SimpleQueue[_Answer | None] = SimpleQueue()

    def setup(self, folder: Path) -> dict[str, Any]:
        """The first message, with what the process needs to begin."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        self._folder = TemporaryDirectory(prefix="rigctl-", ignore_cleanup_errors=True)
        try:
            setup = self.setup(Path(self._folder.name))
        except BaseException:
            self._folder.cleanup()
            raise
        self._child = subprocess.Popen(  # noqa: S603 - the user has asked for this program to be run
            module_command(self._module),
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
        try:
            self._send(setup)
            head, _ = self._answer("been loaded", max(self._patience, PATIENCE))
            if head["reason"]:
                raise self._error(f"{self._noun} {self._verb('does')} not start: {head['reason']}")
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # Killed, not asked to end: it may hang in foreign code. Its end closes the pipes, on which both
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

    def request(self, points: Floats, drives: Floats, starts: Floats) -> None:
        """Ask for a simulation; several may be asked for before the first result.

        Parameters
        ----------
        points: (n) s, increasing.
        drives: (n − 1, inputs) or more rows, held from each point to the next, SI; or as many columns more as
            the program has tunable parameters, which are then set at each point.
        starts: what is set before it begins, SI; NaN where the program's own value is to hold.
        """
        self._send({}, points, drives, starts)

    def result(self, which: str) -> tuple[str, Floats]:
        """When and why the next simulation fails, "" if it does not, and its outputs until then, NaN from
        there on.

        Raises
        ------
        RigctlError
            the process ends, does not return in time, or refuses what it is asked.
        """
        head, rows = self._answer(f"finished {which}", self._patience)
        refused = head.get("refused")
        if refused is not None:
            raise RigctlError(**refused)
        return str(head["reason"]), rows[0]

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
                    code = self._child.wait()
                    raise self._error(f"{self._noun} {self._verb('has')} crashed (exit code {code})")
                return answer
        raise self._error(f"{self._noun} {self._verb('has')} not {what} in {patience:g} s", self._slow)

    def _verb(self, of_one: str) -> str:
        """``has``, or ``have`` for several functions."""
        return {"has": "have", "does": "do"}[of_one] if self._noun.endswith("s") else of_one

    def _error(self, what: str, hint: str = "") -> RigctlError:
        return RigctlError(what, where=self._where, hint=hint or None, exit_code=ExitCode.FAILED)

    def _write_requests(self) -> None:
        """Send the requests; in a thread, because a program that hangs leaves the pipe full, and only who
        waits for its answer knows how long that may take."""
        assert self._child.stdin is not None  # noqa: S101 - it is a pipe
        while (request := self._requests.get()) is not None:
            command, arrays = request
            with suppress(OSError):  # it has ended: so do its answers
                write_message(self._child.stdin, command, *arrays)

    def _read_answers(self) -> None:
        """Forward the answers of the process, None at their end; in a thread, because reading one blocks."""
        assert self._child.stdout is not None  # noqa: S101 - it is a pipe
        while (message := read_message(self._child.stdout)) is not None:
            self._answers.put(message)
        self._answers.put(None)
