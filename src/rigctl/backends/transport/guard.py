"""The guard: a small separate process that holds the port of a device without a watchdog.

It forwards bytes in both directions, and makes outputs safe if rigctl is silent for too long or has ended for
any reason. It knows only the commands that make the bench safe. If the device does not confirm that it is
safe, the guard keeps trying, see `rigctl.backends.transport.safe_state_retries`.

It is started by ``python -P -m rigctl.backends.transport.guard PORT``, where PORT is the TCP port on which
rigctl listens for it; the secret that authenticates it is read from stdin.

Two threads share the port: the main one reads from rigctl and writes to the device (`_serve`), a second one
reads from the device and writes to rigctl (`_listen`). Both write to the socket, hence `_sending`; only the
main one writes to the port, so that no byte of rigctl's can come between the safe commands. Why a process and
not a thread of rigctl: docs/decisions/0012-separate-process-holds-ports-without-watchdog.md.
"""

from __future__ import annotations

import json
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

from rigctl.backends.fine_timers import fine_timers
from rigctl.backends.transport.adapter import same_adapter
from rigctl.backends.transport.address import SERIAL, Address
from rigctl.backends.transport.guard_frames import Frame, FrameReader, send_frame
from rigctl.backends.transport.port import Connect, Port, PortLost
from rigctl.backends.transport.safe_commands import Outputs, SafeOrder
from rigctl.backends.transport.safe_state_retries import Notice, SafeStateRetries, hold, let_go, take_over
from rigctl.clock import Clock, real_clock
from rigctl.errors import RigctlError

_LOOK = 0.1  # s between two checks whether rigctl is silent
_SENT_WITHIN = 1.0  # s for rigctl to take what is sent; one that stands still does not read it
_PAUSE = 0.05  # s between two safe commands, for devices without a buffer
_READ = 0.2  # s
_GIVES_WAY = 2.0  # s for another guard to release the port


@dataclass(frozen=True)
class GuardSettings:
    """The guard's orders: the port, the safe commands, and the longest permitted silence of rigctl.

    Parameters
    ----------
    confirm: sent after each safe command; any other answer is a refusal.
    read_back: the queries that show whether outputs are safe.
    identify: the identity query; None for a device that has none.
    identity: what the device answered to it earlier; None if it was not identified yet.
    reply_ends: the line end of answers.
    timeout: s for an answer.
    """

    address: Address
    safe: tuple[SafeOrder, ...]
    watchdog: float
    confirm: SafeOrder | None = None
    read_back: tuple[SafeOrder, ...] = ()
    identify: SafeOrder | None = None
    identity: Mapping[str, str] | None = None
    reply_ends: str = "\n"
    timeout: float = 0.5

    @property
    def url(self) -> str:
        """The address of the port, for messages."""
        return self.address.url

    def to_json(self) -> bytes:
        """Return the orders as bytes for the guard."""
        plain = {
            **vars(self),
            "address": asdict(self.address),
            "safe": [_plain(order) for order in self.safe],
            "confirm": _plain(self.confirm),
            "read_back": [_plain(order) for order in self.read_back],
            "identify": _plain(self.identify),
        }
        return json.dumps(plain).encode("utf-8")

    @classmethod
    def from_json(cls, content: bytes) -> GuardSettings:
        """Read orders written by `to_json`."""
        fields = json.loads(content)
        orders = {name: tuple(map(_order, fields[name])) for name in ("safe", "read_back")}
        single = {name: fields[name] and _order(fields[name]) for name in ("confirm", "identify")}
        return cls(**{**fields, **orders, **single, "address": Address(**fields["address"])})


def _plain(order: SafeOrder | None) -> list[object] | None:
    return None if order is None else [order.text.decode("utf-8"), list(order.reply), dict(order.values)]


def _order(plain: list[Any]) -> SafeOrder:
    text, reply, values = plain
    return SafeOrder(
        text.encode("utf-8"), tuple(reply), {name: tuple(texts) for name, texts in values.items()}
    )


class Guard:
    """One port and the connection to rigctl.

    Nothing but what rigctl itself sends reaches a device that rigctl has not identified yet.

    Attributes
    ----------
    identity: of the device to be guarded; None before rigctl has identified it.
    here: whether that device is on the port.
    """

    def __init__(self, connection: socket.socket, orders: GuardSettings, port: Port, clock: Clock) -> None:
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
        self.identity: Mapping[str, str] | None = None
        self.here = False

    @property
    def ended(self) -> bool:
        """Whether an end was requested."""
        return self._ended.is_set()

    def run(self) -> Outputs | None:
        """Forward bytes until rigctl releases the port; return the outputs' state, None if rigctl ended."""
        # 1. Serve rigctl, for as long as it is there.
        listener = threading.Thread(target=self._listen, daemon=True)
        listener.start()
        try:
            self._left = self._serve()
        finally:
            self._over.set()
        # 2. rigctl has ended without a word, or with outputs that may be on: off with them at once, unasked
        #   and without waiting for answers. Whether the device has obeyed is found out afterwards, by
        #   `SafeStateRetries`.
        if self._left in (None, Outputs.DRIVEN) and self.here:
            self._make_safe()
        listener.join(2.0 * _READ)
        return self._left

    def end(self) -> None:
        """Request that the guard make outputs safe and end."""
        self._ended.set()

    def _serve(self) -> Outputs | None:
        """Serve rigctl until it releases the port or ends, or until the port is lost while it is silent."""
        self._connection.settimeout(_SENT_WITHIN)
        # A message of any kind is a sign of life, whatever it carries; the loop of rigctl sends one at least
        # every 0.2 s.
        heard, suspended = time.monotonic(), self._clock.suspended()
        while not self._ended.is_set():
            try:
                arrived = select.select([self._connection], [], [], _LOOK)[0]
                data = self._connection.recv(65536) if arrived else None
            except OSError:
                return None
            # The connection has ended with rigctl's process: the system closes it even after SIGKILL.
            if data == b"":
                return None
            # After a suspension outputs become safe before anything that has arrived since is obeyed: rigctl
            # may have woken first. A silence without one is noticed when nothing has arrived for `_LOOK`.
            asleep = self._clock.suspended() - suspended  # this process was silent, too
            silence = time.monotonic() - heard if data is None else 0.0
            if asleep >= self._orders.watchdog:  # before anything that rigctl has sent since
                suspended += asleep
                if self.here and not self._act(asleep):
                    return None
            elif silence >= self._orders.watchdog and not self._act(silence):
                return None
            if data is None:
                continue
            heard = time.monotonic()
            for frame, content in self._reader.feed(data):
                if frame is Frame.CLOSE:
                    return Outputs(content)
                self._obey(frame, content)
        return None

    def _obey(self, frame: Frame, content: bytes) -> None:
        if frame is Frame.IDENTIFIED:
            self.identity, self.here = json.loads(content), True
        # From here on nothing is sent to this port by the guard itself: it is not its device.
        elif frame is Frame.EXCHANGED:
            self.here = False
        elif frame is Frame.RESUME:
            self._acted = False
        elif frame is Frame.WRITE and not self._acted:  # rigctl must not switch outputs on before it knows
            try:
                self._port.write(content)
            except PortLost as error:
                self._tell(Frame.LOST, str(error).encode("utf-8"))

    def _act(self, silence: float) -> bool:
        """Make outputs safe, repeatedly while rigctl is silent; return False if that is not possible here."""
        now = time.monotonic()
        # Not identified yet, or another device: nothing may be sent. The guard ends instead, which rigctl
        # notices.
        if not self.here:
            return False
        if self._acted and now < self._next_act:
            return True
        # Until rigctl answers ACTED with RESUME, its commands are dropped: they were made without knowing of
        # this. The safe commands are repeated, as a device may have missed the first ones.
        first, self._acted = not self._acted, True
        self._next_act = now + self._orders.watchdog
        done = self._make_safe()
        # Also if a port was lost half-way: the first of the commands may have got through.
        if first:
            self._tell(Frame.ACTED, f"{silence:.3f}".encode("ascii"))
        return done

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
            # What answers the guard's commands must not be taken for the answer to a query of rigctl's.
            if data and not self._acted:
                self._tell(Frame.DATA, data)

    def _tell(self, frame: Frame, content: bytes) -> None:
        with self._sending, suppress(OSError):
            send_frame(self._connection, frame, content)


def main() -> int:
    """Connect to rigctl, open the port that it names, and guard it."""
    # The secret comes on stdin, as arguments of a process can be read by other users.
    secret = sys.stdin.readline().strip()
    for name in ("SIGINT", "SIGHUP", "SIGBREAK"):  # meant for rigctl, to whose reaction the guard responds
        number = getattr(signal, name, None)
        if number is not None:
            signal.signal(number, signal.SIG_IGN)
    with (
        fine_timers(),
        socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=10.0) as connection,
    ):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        send_frame(connection, Frame.ALIVE, secret.encode("ascii"))
        orders = GuardSettings.from_json(_first(connection))
        clock = real_clock()
        connect = _connect(orders, clock)
        try:
            port, inherited = _open(orders, connect)
        except (RigctlError, PortLost) as error:
            send_frame(connection, Frame.REFUSED, _refusal(error))
            return 1
        # From now on earlier guards of this device know that it is in other hands, and end.
        holding = hold(orders.address.key)
        guard = Guard(connection, orders, port, clock)
        signal.signal(signal.SIGTERM, lambda _number, _frame: guard.end())
        send_frame(connection, Frame.OPENED)
        try:
            left = guard.run()
        except BaseException:
            port.close()
            raise
    # Only now, with rigctl gone: make safe what has to be, with confirmation, for as long as it takes.
    done, still_open = True, [port]
    for identity in _unsafe(left, guard, orders, inherited):
        unsafe = replace(orders, identity=identity)
        retries = SafeStateRetries(unsafe, clock, connect, lambda: guard.ended, holding)
        # Only a device that was identified on this very connection is trusted without being asked again.
        known = guard.here and identity == guard.identity
        done = retries.carry_out(still_open.pop() if still_open else None, known=known) and done
    for port in still_open:
        port.close()
    let_go(orders.address.key, holding)
    return 0 if done else 1


def _unsafe(
    left: Outputs | None, guard: Guard, orders: GuardSettings, inherited: Notice | None
) -> list[Mapping[str, str] | None]:
    """Return the identities of the devices that still have to be made safe; None: of the rig file's kind.

    Besides the device of this guard, that is the one that an earlier guard was trying to reach: there may be
    another one on the port by now.
    """
    known = guard.identity if guard.identity is not None else orders.identity
    found: list[Mapping[str, str] | None] = []
    touched = left is None or left is Outputs.DRIVEN
    if touched and known is not None:
        found.append(known)
    if inherited is not None and (inherited.identity is None or inherited.identity != known):
        if inherited.identity is not None or left is not Outputs.SAFE:
            found.append(inherited.identity)
    elif inherited is not None and left is Outputs.UNTOUCHED:
        found.append(known)
    return found


def _connect(orders: GuardSettings, clock: Clock) -> Connect:
    """Return what opens the port, as long as it has the same USB adapter as at first."""

    def connect() -> Port:
        return orders.address.open(clock)

    return same_adapter(connect, orders.url) if orders.address.kind in SERIAL else connect


def _open(orders: GuardSettings, connect: Connect) -> tuple[Port, Notice | None]:
    """Open the port; also return the notice of another guard that was making its device safe, now stopped."""
    # A guard left behind by an earlier run may hold the port: removing its notice asks it to let go, and the
    # port is tried until it has. Its device is then this guard's to make safe, too.
    give_up = time.monotonic() + _GIVES_WAY
    inherited: Notice | None = None
    while True:
        try:
            port = connect()
            return port, take_over(orders.address.key) or inherited
        except RigctlError:
            inherited = take_over(orders.address.key) or inherited
            if inherited is None or time.monotonic() >= give_up:
                raise
            time.sleep(_PAUSE)


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
