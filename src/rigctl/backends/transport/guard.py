"""The guard: a small separate process that holds the port of a device without a watchdog.

It forwards bytes in both directions, and makes outputs safe if rigctl is silent for too long or has ended for
any reason. It knows only the commands that make the bench safe. If the device does not confirm that it is
safe, the guard keeps trying, see `rigctl.backends.transport.safe_state_retries`.

It is started by ``python -P -m rigctl.backends.transport.guard PORT``, where PORT is the TCP port on which
rigctl listens for it; the secret that authenticates it is read from stdin.
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
from typing import Any

from rigctl.backends.transport.address import Address
from rigctl.backends.transport.guard_frames import Frame, FrameReader, send_frame
from rigctl.backends.transport.port import Port, PortLost
from rigctl.backends.transport.safe_commands import Outputs, SafeOrder
from rigctl.backends.transport.safe_state_retries import SafeStateRetries, hold, let_go, take_over
from rigctl.clock import Clock, real_clock
from rigctl.errors import RigctlError

_LOOK = 0.1  # s between two checks whether rigctl is silent
_PAUSE = 0.05  # s between two safe commands, for devices without a buffer
_READ = 0.2  # s
_GIVES_WAY = 2.0  # s for another guard to release the port


@dataclass(frozen=True)
class Orders:
    """The guard's orders: the port, the safe commands, and the longest permitted silence of rigctl."""

    address: Address
    safe: tuple[SafeOrder, ...]
    watchdog: float
    identify: SafeOrder | None = None
    reply_ends: str = "\n"

    @property
    def url(self) -> str:
        """The address of the port, for messages."""
        return self.address.url

    def to_json(self) -> bytes:
        """Return the orders as bytes for the guard."""
        plain = {
            **vars(self),
            "address": vars(self.address),
            "safe": [_plain(order) for order in self.safe],
            "identify": None if self.identify is None else _plain(self.identify),
        }
        return json.dumps(plain).encode("utf-8")

    @classmethod
    def from_json(cls, content: bytes) -> Orders:
        """Read orders written by `to_json`."""
        fields = json.loads(content)
        who = fields["identify"]
        safe = tuple(_order(plain) for plain in fields["safe"])
        return cls(
            **{
                **fields,
                "address": Address(**fields["address"]),
                "safe": safe,
                "identify": None if who is None else _order(who),
            }
        )


def _plain(order: SafeOrder) -> list[object]:
    return [order.text.decode("utf-8"), list(order.reply), order.value]


def _order(plain: list[Any]) -> SafeOrder:
    text, reply, value = plain
    return SafeOrder(text.encode("utf-8"), tuple(reply), value)


class Guard:
    """One port and the connection to rigctl."""

    def __init__(self, connection: socket.socket, orders: Orders, port: Port, clock: Clock) -> None:
        self._connection = connection
        self._orders = orders
        self._port = port
        self._clock = clock
        self._reader = FrameReader()
        self._sending = threading.Lock()
        self._ended = threading.Event()  # an end was requested
        self._over = threading.Event()  # rigctl no longer listens
        self._acted = False  # it has made outputs safe, and rigctl has not acknowledged that yet
        self._next_act = 0.0
        self._left: Outputs | None = None  # state in which rigctl released the port; None: it has ended

    @property
    def ended(self) -> bool:
        """Whether an end was requested."""
        return self._ended.is_set()

    def run(self) -> Outputs | None:
        """Forward bytes until rigctl releases the port; return the outputs' state, None if rigctl ended."""
        listener = threading.Thread(target=self._listen, daemon=True)
        listener.start()
        try:
            self._left = self._serve()
        finally:
            self._over.set()
        if self._left in (None, Outputs.DRIVEN):
            self._make_safe()
        listener.join(2.0 * _READ)
        return self._left

    def end(self) -> None:
        """Request that the guard make outputs safe and end."""
        self._ended.set()

    def _serve(self) -> Outputs | None:
        """Serve rigctl until it releases the port or ends, or until the port is lost while it is silent."""
        self._connection.settimeout(_LOOK)
        heard = time.monotonic()
        while not self._ended.is_set():
            try:
                data = self._connection.recv(65536)
            except TimeoutError:
                silence = time.monotonic() - heard
                if silence >= self._orders.watchdog and not self._act(silence):
                    return None
                continue
            except OSError:
                return None
            if not data:
                return None
            heard = time.monotonic()
            for frame, content in self._reader.feed(data):
                if frame is Frame.CLOSE:
                    return Outputs(content)
                self._obey(frame, content)
        return None

    def _obey(self, frame: Frame, content: bytes) -> None:
        if frame is Frame.RESUME:
            self._acted = False
        elif frame is Frame.WRITE and not self._acted:  # rigctl must not switch outputs on before it knows
            try:
                self._port.write(content)
            except PortLost as error:
                self._tell(Frame.LOST, str(error).encode("utf-8"))

    def _act(self, silence: float) -> bool:
        """Make outputs safe, repeatedly while rigctl is silent; return False if the port is lost."""
        now = time.monotonic()
        if self._acted and now < self._next_act:
            return True
        first, self._acted = not self._acted, True
        self._next_act = now + self._orders.watchdog
        if not self._make_safe():
            return False
        if first:
            self._tell(Frame.ACTED, f"{silence:.3f}".encode("ascii"))
        return True

    def _make_safe(self) -> bool:
        for order in self._orders.safe:
            try:
                self._port.write(order.text)
            except PortLost:
                return False
            time.sleep(_PAUSE)
        return True

    def _listen(self) -> None:
        """Forward what the device sends."""
        while not self._over.is_set():
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
    """Connect to rigctl, open the port that it names, and guard it."""
    secret = sys.stdin.readline().strip()
    for name in ("SIGINT", "SIGHUP", "SIGBREAK"):  # meant for rigctl, to whose reaction the guard responds
        number = getattr(signal, name, None)
        if number is not None:
            signal.signal(number, signal.SIG_IGN)
    with socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=10.0) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        send_frame(connection, Frame.ALIVE, secret.encode("ascii"))
        orders = Orders.from_json(_first(connection))
        clock = real_clock()
        try:
            port, inherited = _open(orders, clock)
        except (RigctlError, PortLost) as error:
            send_frame(connection, Frame.REFUSED, _refusal(error))
            return 1
        holding = hold(orders.url)
        guard = Guard(connection, orders, port, clock)
        signal.signal(signal.SIGTERM, lambda _number, _frame: guard.end())
        send_frame(connection, Frame.OPENED)
        try:
            left = guard.run()
        except BaseException:
            port.close()
            raise
    if left is Outputs.SAFE or (left is Outputs.UNTOUCHED and not inherited):
        port.close()
        let_go(orders.url, holding)
        return 0
    done = _retry_until_safe(guard, orders, port, clock, holding)
    let_go(orders.url, holding)
    return 0 if done else 1


def _open(orders: Orders, clock: Clock) -> tuple[Port, bool]:
    """Open the port; also return whether another guard, which is stopped, was making its device safe."""
    give_up = time.monotonic() + _GIVES_WAY
    inherited = False
    while True:
        try:
            port = orders.address.open(clock)
            return port, take_over(orders.url) is not None or inherited
        except RigctlError:
            inherited = take_over(orders.url) is not None or inherited
            if not inherited or time.monotonic() >= give_up:
                raise
            time.sleep(_PAUSE)


def _retry_until_safe(guard: Guard, orders: Orders, port: Port, clock: Clock, holding: str) -> bool:
    """Continue until the device confirms that it is safe; return False as `SafeStateRetries.carry_out`."""
    retries = SafeStateRetries(
        orders, clock, lambda: orders.address.open(clock), lambda: guard.ended, holding
    )
    return retries.carry_out(port)


def _first(connection: socket.socket) -> bytes:
    """Read the orders, which are the first frame."""
    reader = FrameReader()
    while True:
        data = connection.recv(65536)
        if not data:
            raise ConnectionError("rigctl is gone")
        for frame, content in reader.feed(data):
            if frame is Frame.CONFIGURE:
                return content


def _refusal(error: RigctlError | PortLost) -> bytes:
    details = (
        {"what": error.what, "value": error.value, "hint": error.hint}
        if isinstance(error, RigctlError)
        else {"lost": str(error)}
    )
    return json.dumps(details).encode("utf-8")


if __name__ == "__main__":
    sys.exit(main())
