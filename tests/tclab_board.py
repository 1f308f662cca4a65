"""A stand-in for the two-heater temperature lab board: its sketch's protocol on the tclab package's model.

It is offered in memory with a virtual clock, on a TCP port (``socket://``), or on a pseudo-terminal.
"""

from __future__ import annotations

import contextlib
import io
import os
import socket
import sys
import threading
import time
import types
from collections.abc import Callable
from typing import Any, Self
from unittest import mock

from rigctl.clock import VirtualClock
from rigctl.testing import FakeSerial

VERSION = "TCLab Firmware 1.4.0 Arduino Uno"


def _model_class() -> Any:
    """The model of the package `tclab`, which imports the list of ports too: that fails under Wine."""
    try:
        import serial.tools.list_ports  # noqa: F401
    except AttributeError:
        none = types.ModuleType("serial.tools.list_ports")
        none.comports = list  # type: ignore[attr-defined]
        with mock.patch.dict(sys.modules, {none.__name__: none}):
            from tclab import TCLabModel
    else:
        from tclab import TCLabModel
    return TCLabModel


class Sketch:
    """What the board's program does with each line; it has no watchdog or interlock.

    Parameters
    ----------
    now: s, the board's time.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        TCLabModel = _model_class()
        with contextlib.redirect_stdout(io.StringIO()):
            self.model = TCLabModel(synced=False)
        self._now = now
        self._rest = b""
        self.received: list[str] = []
        self.odd: dict[str, bytes] = {}  #: command -> what is sent instead of the answer, once
        self.always: dict[str, bytes] = {}  #: the same, each time

    @property
    def heaters(self) -> tuple[float, float]:
        return float(self.model._Q1), float(self.model._Q2)

    def reset(self) -> None:
        """As after a brown-out: the program restarts, heaters off."""
        self._rest = b""
        self.model.update(self._now())
        self.model._Q1 = self.model._Q2 = 0

    def take(self, data: bytes) -> bytes:
        """Bytes from the host in, bytes to the host out."""
        *lines, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        return b"".join(self._answer(line.decode("ascii", "replace").strip()) for line in lines)

    def _answer(self, line: str) -> bytes:
        if not line:
            return b""
        self.received.append(line)
        self.model.update(self._now())
        if line in self.always:
            return self.always[line]
        if line in self.odd:
            return self.odd.pop(line)
        name, _, argument = line.upper().partition(" ")
        answers = {
            "T1": lambda: f"{self.model.measurement(self.model._T1):.3f}",
            "T2": lambda: f"{self.model.measurement(self.model._T2):.3f}",
            "Q1": lambda: self._heat("_Q1", argument),
            "Q2": lambda: self._heat("_Q2", argument),
            "R1": lambda: f"{self.model._Q1:.2f}",
            "R2": lambda: f"{self.model._Q2:.2f}",
            "P1": lambda: f"{self.model._P1:.2f}",
            "P2": lambda: f"{self.model._P2:.2f}",
            "VER": lambda: VERSION,
            "SCAN": lambda: "\r\n".join(answers[name]() for name in ("T1", "T2", "R1", "R2")),
        }
        if name not in answers:  # X, and every unknown command
            self.model._Q1 = self.model._Q2 = 0
            return f"{name}\r\n".encode()
        return f"{answers[name]()}\r\n".encode()

    def _heat(self, name: str, argument: str) -> str:
        value = max(0.0, min(100.0, float(argument or 0.0)))
        setattr(self.model, name, value)
        return f"{value:.2f}"


class MemoryPort(FakeSerial):
    """A port to a sketch on a virtual clock."""

    name = "the board in memory"

    def __init__(self, sketch: Sketch, clock: VirtualClock) -> None:
        super().__init__(sketch, clock)
        self.sketch = sketch


class Served:
    """A sketch on a TCP port or a pseudo-terminal, in real time, in a thread of its own.

    Attributes
    ----------
    url: what pyserial opens.
    switched: wall times (monotonic) at which the heaters were switched, with their values.
    """

    def __init__(self, *, pty: bool = False, speed: float = 1.0) -> None:
        began = time.monotonic()
        self.sketch = Sketch(lambda: (time.monotonic() - began) * speed)
        self.switched: list[tuple[float, tuple[float, float]]] = []
        self.mute = False  #: the line is dead in both directions, but the port exists
        self.unplugged = False  #: closes the connection, and takes no other
        self._end = threading.Event()
        self._server: socket.socket | None = None
        self._master = -1
        if pty:
            import tty

            self._master, slave = os.openpty()
            tty.setraw(slave)
            self.url = os.ttyname(slave)
            self._slave = slave  # kept open, so that a client may come and go
            os.set_blocking(self._master, False)
        else:
            self._server = socket.create_server(("127.0.0.1", 0))
            self._server.settimeout(0.05)
            self.url = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve_pty if pty else self._serve_tcp)
        self._thread.start()

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        if self._server is not None:
            self._server.close()
        else:
            os.close(self._master)
            os.close(self._slave)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _take(self, data: bytes) -> bytes:
        if self.mute or self.unplugged:
            return b""
        before = self.sketch.heaters
        answer = self.sketch.take(data)
        if self.sketch.heaters != before:
            self.switched.append((time.monotonic(), self.sketch.heaters))
        return answer

    def _serve_tcp(self) -> None:
        assert self._server is not None
        while not self._end.is_set():
            try:
                client, _ = self._server.accept()
            except TimeoutError:
                continue
            with client:
                client.settimeout(0.02)
                while not (self._end.is_set() or self.unplugged):
                    try:
                        data = client.recv(4096)
                        if not data:
                            break
                        client.sendall(self._take(data))
                    except TimeoutError:
                        continue
                    except OSError:
                        break

    def _serve_pty(self) -> None:
        while not self._end.is_set():
            try:
                data = os.read(self._master, 4096)
            except (BlockingIOError, OSError):
                time.sleep(0.002)
                continue
            answer = self._take(data)
            if answer:
                os.write(self._master, answer)
