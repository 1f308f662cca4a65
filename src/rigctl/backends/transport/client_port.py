"""A line-based port to a protocol library, which runs in a separate thread.

A protocol library blocks while its device is silent. With this port only the library's thread blocks, and the
line-based code for queries, guards and reconnection can be used with any protocol.

In: lines of `rigctl.rig.protocols.client_lines`, written by the loop's thread. Out: one line for each
answer. Two queues are all that the threads share; the client is made, used and closed by its own thread
alone. A thread that is stuck in its library cannot be ended: it is left behind, and the next port to the
same device waits until it has come back.
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
_ENDS_WITHIN = 0.2  # s after which a library that is still waiting for its device is abandoned
_GIVES_WAY = 10.0  # s for which the next port to the same device waits for an abandoned library to end

#: by device, the thread of the port opened last
_threads: dict[str, Thread] = {}


class Client(Protocol):
    """A library's connection to one device, used in one thread only."""

    def answer(self, line: str) -> str | None:
        """Return the device's answer to a line; None without an answer.

        Raises
        ------
        PortLost
            the connection is gone.
        """
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


class ClientPort:
    """A `Port` to a `Client`.

    Opening does not block: if the device cannot be reached, the port is lost as soon as that is known.

    Parameters
    ----------
    name: name of the device in messages.
    connect: connects to the device; raises `PortLost`, or any error of the library.
    clock: the clock for waits; real.
    """

    def __init__(self, name: str, connect: Callable[[], Client], clock: Clock) -> None:
        self.name = name
        self._clock = clock
        self._requests: SimpleQueue[str | None] = SimpleQueue()
        self._answers: SimpleQueue[bytes | None] = SimpleQueue()  # None if the device is lost
        self._lost: PortLost | None = None
        self._begun = b""
        self._left = False  # the device was silent when the port was closed
        self._asked = math.inf  # start of the query in progress, s; infinite without one
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
        # Bytes may arrive in any pieces, as on a real line.
        *lines, self._begun = (self._begun + data).split(b"\n")
        for line in lines:
            if line.strip():
                self._requests.put(line.decode("utf-8", "replace").strip())

    def read(self, until: float) -> bytes:
        """Return the answers up to bench time `until`, as soon as there is one; raises `PortLost`."""
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
            self._answers.put(None)  # so that later reads fail too
            raise PortLost(str(self._lost))
        return answer

    def close(self) -> None:
        """Close the port; commands already sent are executed, unless the device has been silent for too long.

        Commands that a silent device has not received are dropped, since they might contradict later ones.
        """
        # Read by the other thread after each answer: what is still queued for a silent device is then not
        # sent.
        self._left = time.monotonic() - self._asked > _ENDS_WITHIN
        self._requests.put(None)
        if not self._left:
            self._thread.join(_ENDS_WITHIN)
            self._left = self._thread.is_alive()

    def _serve(self, connect: Callable[[], Client], earlier: Thread | None) -> None:
        if earlier is not None:  # its outstanding commands must precede anything sent from now on
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
        except Exception as error:  # noqa: BLE001 - libraries may raise any error, and the port is then lost
            self._lose(PortLost(f"{self.name}: {type(error).__name__}: {error}"))

    def _lose(self, error: PortLost) -> None:
        self._lost = error
        self._answers.put(None)
