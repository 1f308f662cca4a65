"""The client of a driver's process: passes lines on, and ends a process whose call takes too long."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any

from rigctl.backends.python.driver_process import start_process
from rigctl.backends.transport.client_port import ClientPort
from rigctl.backends.transport.port import PortLost
from rigctl.clock import Clock

_ENDS_WITHIN = 0.5  # s for the process to end by itself


def open_port(url: str, settings: Mapping[str, Any], clock: Clock) -> ClientPort:
    """Open the port of an `Address`: a driver, or the port that it is given.

    Its settings are those of `rigctl.backends.python.create.settings_of`.
    """
    return ClientPort(url, lambda: DriverClient(url, settings), clock)


class DriverClient:
    """One driver in a process of its own.

    Raises
    ------
    PortLost
        the driver cannot be made.
    """

    def __init__(self, url: str, settings: Mapping[str, Any]) -> None:
        self._name = url
        self._timeout = float(settings["timeout"])
        self._said: SimpleQueue[dict[str, str] | None] = SimpleQueue()  # None at the end of the process
        self._process = start_process()
        threading.Thread(target=self._listen, daemon=True, name=f"driver of {url}").start()
        try:
            self._send(json.dumps(settings))
            self._take(float(settings["wake"]))
        except BaseException:
            self._end()
            raise

    def answer(self, line: str) -> str:
        """Return the driver's answer to a line of `rigctl.rig.protocols.client_lines`."""
        try:
            self._send(line)
            return self._take(self._timeout)
        except PortLost:
            self._end()
            raise

    def close(self) -> None:
        """End the process; the driver is asked to, unless it is stuck in a call."""
        with suppress(OSError, PortLost):
            self._send("quit")
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_ENDS_WITHIN)
        self._end()

    def _send(self, line: str) -> None:
        assert self._process.stdin is not None  # noqa: S101 - opened as a pipe
        try:
            self._process.stdin.write(f"{line}\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            raise PortLost(self._why_ended()) from None

    def _take(self, limit: float) -> str:
        """Return the answer to the last line; each call of the driver may take `limit` s."""
        call, until = "start", time.monotonic() + limit
        while True:
            try:
                said = self._said.get(timeout=max(until - time.monotonic(), 0.001))
            except Empty:
                raise PortLost(
                    f"{self._name}: the driver has not come back from {call!r} in {limit:g} s"
                ) from None
            if said is None:
                raise PortLost(self._why_ended())
            if "lost" in said:
                raise PortLost(f"{self._name}: {said['lost']}")
            if "answer" in said:
                return said["answer"]
            # The process announces each call into the driver: the time limit counts for one call, and the
            # message names it.
            call, until = said["calls"], time.monotonic() + limit

    def _why_ended(self) -> str:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_ENDS_WITHIN)
        code = self._process.returncode
        how = "" if code is None else f" (signal {-code})" if code < 0 else f" (exit status {code})"
        return f"{self._name}: the process of the driver has ended{how}"

    def _listen(self) -> None:
        assert self._process.stdout is not None  # noqa: S101 - opened as a pipe
        with suppress(ValueError, OSError):
            for line in self._process.stdout:
                self._said.put(json.loads(line))
        self._said.put(None)

    def _end(self) -> None:
        """End the process at once, whatever its driver does, and release the pipes."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError, ValueError):
                    pipe.close()
