"""The guard: a small process of its own that holds the port of a device which does not guard itself.

It passes bytes both ways, and makes outputs safe when nothing is heard of rigctl for too long, or when rigctl
is gone, however it ended. It knows nothing of the bench but the bytes that make it safe.

``python -P -m rigctl.backends.lines.guard PORT`` where PORT is the TCP port at which rigctl waits for it; the
secret that shows who it is comes on stdin.
"""

from __future__ import annotations

import json
import signal
import socket
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass

from rigctl.backends.lines.frames import Frame, FrameReader, send_frame
from rigctl.backends.serial.port import PortLost
from rigctl.backends.serial.pyserial_port import PyserialPort
from rigctl.clock import Clock, real_clock
from rigctl.errors import RigctlError

_LOOK = 0.1  # s between two looks at how long rigctl has been silent
_PAUSE = 0.05  # s between two commands that make safe: a device without a buffer needs it
_READ = 0.2  # s


@dataclass(frozen=True)
class Orders:
    """What the guard is told: which port, what makes safe, and after how much silence."""

    url: str
    baud: int
    frame: str
    safe: tuple[bytes, ...]
    watchdog: float

    def to_json(self) -> bytes:
        """As bytes for the line to the guard."""
        return json.dumps({**vars(self), "safe": [text.decode("utf-8") for text in self.safe]}).encode(
            "utf-8"
        )

    @classmethod
    def from_json(cls, content: bytes) -> Orders:
        """Read what `to_json` wrote."""
        told = json.loads(content)
        return cls(**{**told, "safe": tuple(text.encode("utf-8") for text in told["safe"])})


class Guard:
    """One port and the connection to rigctl."""

    def __init__(self, connection: socket.socket, orders: Orders, port: PyserialPort, clock: Clock) -> None:
        self._connection = connection
        self._orders = orders
        self._port = port
        self._clock = clock
        self._reader = FrameReader()
        self._sending = threading.Lock()
        self._ended = threading.Event()
        self._acted = False  # and rigctl does not know it yet

    def stand(self) -> None:
        """Pass bytes until rigctl lets the port go, or is gone; outputs are safe then."""
        listener = threading.Thread(target=self._listen, daemon=True)
        listener.start()
        try:
            in_order = self._serve()
        finally:
            self._ended.set()
        if not in_order:
            self._make_safe()
        listener.join(2.0 * _READ)

    def end(self) -> None:
        """Ask it to make outputs safe and end."""
        self._ended.set()

    def _serve(self) -> bool:
        """True when rigctl let the port go in order."""
        self._connection.settimeout(_LOOK)
        heard = time.monotonic()
        while not self._ended.is_set():
            try:
                data = self._connection.recv(65536)
            except TimeoutError:
                silence = time.monotonic() - heard
                if silence >= self._orders.watchdog and not self._acted:
                    self._act(silence)
                continue
            except OSError:
                return False
            if not data:
                return False
            heard = time.monotonic()
            for frame, content in self._reader.feed(data):
                if frame is Frame.CLOSE:
                    return True
                self._obey(frame, content)
        return False

    def _obey(self, frame: Frame, content: bytes) -> None:
        if frame is Frame.RESUME:
            self._acted = False
        elif frame is Frame.WRITE and not self._acted:  # what rigctl did not yet know it must not undo
            try:
                self._port.write(content)
            except PortLost as error:
                self._tell(Frame.LOST, str(error).encode("utf-8"))

    def _act(self, silence: float) -> None:
        self._acted = True
        self._make_safe()
        self._tell(Frame.ACTED, f"{silence:.3f}".encode("ascii"))

    def _make_safe(self) -> None:
        for text in self._orders.safe:
            try:
                self._port.write(text)
            except PortLost:
                return  # without a line there is nothing to be done from here
            time.sleep(_PAUSE)

    def _listen(self) -> None:
        """What the device says."""
        while not self._ended.is_set():
            try:
                data = self._port.read(self._clock.now() + _READ)
            except PortLost as error:
                self._tell(Frame.LOST, str(error).encode("utf-8"))
                return
            if data:
                self._tell(Frame.DATA, data)

    def _tell(self, frame: Frame, content: bytes) -> None:
        with self._sending, suppress(OSError):
            send_frame(self._connection, frame, content)


def main() -> int:
    """Connect to rigctl, open the port that it names, and stand guard."""
    secret = sys.stdin.readline().strip()
    for name in ("SIGINT", "SIGHUP", "SIGBREAK"):  # meant for rigctl; what it does then is heard here
        number = getattr(signal, name, None)
        if number is not None:
            signal.signal(number, signal.SIG_IGN)
    with socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=10.0) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        send_frame(connection, Frame.ALIVE, secret.encode("ascii"))
        orders = Orders.from_json(_first(connection))
        clock = real_clock()
        try:
            port = PyserialPort(orders.url, orders.baud, clock, orders.frame)
        except (RigctlError, PortLost) as error:
            send_frame(connection, Frame.REFUSED, _refusal(error))
            return 1
        guard = Guard(connection, orders, port, clock)
        signal.signal(signal.SIGTERM, lambda _number, _frame: guard.end())
        send_frame(connection, Frame.OPENED)
        try:
            guard.stand()
        finally:
            port.close()
    return 0


def _first(connection: socket.socket) -> bytes:
    """The orders: the first frame that comes."""
    reader = FrameReader()
    while True:
        data = connection.recv(65536)
        if not data:
            raise ConnectionError("rigctl is gone")
        for frame, content in reader.feed(data):
            if frame is Frame.CONFIGURE:
                return content


def _refusal(error: RigctlError | PortLost) -> bytes:
    told = (
        {"what": error.what, "value": error.value, "hint": error.hint}
        if isinstance(error, RigctlError)
        else {"lost": str(error)}
    )
    return json.dumps(told).encode("utf-8")


if __name__ == "__main__":
    sys.exit(main())
