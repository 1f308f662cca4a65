"""A port to a device that a library speaks to: lines in, lines out, and the library in a thread of its own.

A protocol library blocks for as long as its device is silent. Behind this port nobody waits for it but its
thread, and whatever talks in lines, guards and reconnects does so with any protocol.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Protocol

from rigctl.backends.transport.port import PortLost
from rigctl.clock import Clock

_LONGEST_WAIT = 0.5  # s of wall time in one read
_ENDS_WITHIN = 0.2  # s; a library that is still waiting for its device then is left to itself
_GIVES_WAY = 10.0  # s; for so long the next port to the device waits for that library

#: by device, the thread of the port that was opened last
_threads: dict[str, Thread] = {}


class Client(Protocol):
    """A library's connection to one device; all of it is called in one thread."""

    def answer(self, line: str) -> str | None:
        """What the device says to a line; None when it says nothing.

        Raises
        ------
        PortLost
            the connection is gone.
        """
        ...

    def close(self) -> None:
        """Let the device go."""
        ...


class ClientPort:
    """A `Port` whose other end is a `Client`.

    Opening it waits for nothing: a device that cannot be reached is lost as soon as that is known.

    Parameters
    ----------
    name: what the device is called in messages.
    connect: reaches the device; raises `PortLost`, or whatever the library raises.
    clock: what waits are counted on; real.
    """

    def __init__(self, name: str, connect: Callable[[], Client], clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._requests: SimpleQueue[str | None] = SimpleQueue()
        self._answers: SimpleQueue[bytes | None] = SimpleQueue()  # None when it is lost
        self._lost: PortLost | None = None
        self._begun = b""
        self._left = False  # the device was silent when the port was closed
        self._asked = math.inf  # when the question was asked that has no answer yet, s
        earlier = _threads.get(name)
        self._thread = Thread(
            target=self._serve, args=(connect, earlier), daemon=True, name=f"client of {name}"
        )
        _threads[name] = self._thread
        self._thread.start()

    def write(self, data: bytes) -> None:
        """Send lines; raises `PortLost`."""
        if self._lost is not None:
            raise PortLost(str(self._lost))
        *lines, self._begun = (self._begun + data).split(b"\n")
        for line in lines:
            if line.strip():
                self._requests.put(line.decode("utf-8", "replace").strip())

    def read(self, until: float) -> bytes:
        """What has been answered by bench time `until`, as soon as something has; raises `PortLost`."""
        left = (until - self._clock.now()) / self._clock.speed
        try:
            answer = (
                self._answers.get(timeout=min(left, _LONGEST_WAIT))
                if left > 0.0
                else self._answers.get_nowait()
            )
        except Empty:
            return b""
        if answer is None:
            self._answers.put(None)  # whoever reads again is to know it too
            raise PortLost(str(self._lost))
        return answer

    def close(self) -> None:
        """Let it go; what was sent is carried out, unless the device has been silent for long.

        What a silent device was not sent by then it is not sent later, when it may have been told otherwise.
        """
        self._left = time.monotonic() - self._asked > _ENDS_WITHIN
        self._requests.put(None)
        if not self._left:
            self._thread.join(_ENDS_WITHIN)
            self._left = self._thread.is_alive()

    def _serve(self, connect: Callable[[], Client], earlier: Thread | None) -> None:
        if earlier is not None:  # what it still has under way comes before anything that is sent from now on
            earlier.join(_GIVES_WAY)
        try:
            client = connect()
            try:
                while not self._left and (line := self._requests.get()) is not None:
                    self._asked = time.monotonic()
                    answer = client.answer(line)
                    self._asked = math.inf
                    if answer is not None:
                        self._answers.put(f"{answer}\n".encode())
            finally:
                client.close()
        except PortLost as error:
            self._lose(error)
        except Exception as error:  # noqa: BLE001 - libraries raise what they like; the port is lost by all of it
            self._lose(PortLost(f"{self.name}: {type(error).__name__}: {error}"))

    def _lose(self, error: PortLost) -> None:
        self._lost = error
        self._answers.put(None)
