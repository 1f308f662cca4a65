"""Makes an unreachable device safe: repeats the safe commands until the device confirms them.

A guard does this after rigctl has ended with outputs that may be on. A small file in the user's state folder,
the notice, reports it to `rigctl doctor`, `monitor` and `off`; a program that opens the port removes the
file, which ends the guard.

Two files for each address, in the folder of guards: ``KEY.json``, the notice of the guard that is trying,
and ``KEY.holder``, the process that has opened the port last. Each is replaced or removed by whoever
takes over, and a guard that no longer finds its own token stops. Two guards on one device would
contradict each other; worse, one left over from yesterday would switch off today's run.

An attempt is: open the port if it is closed, identify the device, send every safe command, read every
state back, identify the device again. Nothing is sent to a device that can be identified and has not
been, in this attempt or just before. See docs/decisions/0042-unconfirmed-endings-are-reported.md and
0137-only-read-back-outputs-are-safe.md.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Protocol
from uuid import uuid4

from rigctl.backends.processes import process_exists
from rigctl.backends.transport.address import Address
from rigctl.backends.transport.address_key import file_name
from rigctl.backends.transport.port import AnotherDevice, Port, PortLost
from rigctl.backends.transport.safe_commands import SafeOrder
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.files.regular import read_text
from rigctl.files.write import replace_file
from rigctl.json_values import parse_json

LASTS = 24 * 3600.0  #: s, after which the guard gives up
_FIRST_PAUSE, _LONGEST_PAUSE = 0.1, 5.0  # s between two attempts; doubled each time
_LOOK = 0.05  # s between two checks whether another program has taken over the port
_MOST_ERRORS = 50  # in a device's queue
_LONGEST_NOISE = 1.0  # s for a device to stop sending what nobody has asked for
_MOST_READS = 1000  # of what it sends
_OLD = 60.0  # s without a report after which it is unknown whether a guard is still trying


@dataclass(frozen=True)
class Notice:
    """A guard's report of its attempts: the port, since when, how many, and why they fail.

    `since` and `newest` are calendar times in s; `given_up` is true once it has stopped trying; `identity` is
    that of the device, as far as known.
    """

    token: str
    port: str
    pid: int
    since: float
    newest: float
    attempts: int = 0
    trouble: str = ""
    given_up: bool = False
    identity: Mapping[str, str] | None = None

    def __str__(self) -> str:
        last = datetime.fromtimestamp(self.newest).astimezone().isoformat(" ", "seconds")
        if self.given_up or not process_exists(self.pid):
            what = f"ended without success at {last}, after {self.attempts} attempts"
        elif abs(time.time() - self.newest) > _OLD:
            what = f"was last heard of at {last}, after {self.attempts} attempts"
        else:
            age = max(time.time() - self.since, 0.0)
            what = f"has tried for {age:.0f} s, {self.attempts} times,"
        trouble = f": {self.trouble}" if self.trouble else ""
        who = f" ({', '.join(self.identity.values())})" if self.identity else ""
        return f"a guard (process {self.pid}) {what} to make outputs safe on {self.port}{who}{trouble}"


class SafeStateSettings(Protocol):
    """The part of a guard's orders that is used here."""

    @property
    def address(self) -> Address:
        """The address of the port."""
        ...

    @property
    def safe(self) -> tuple[SafeOrder, ...]:
        """The safe commands."""
        ...

    @property
    def confirm(self) -> SafeOrder | None:
        """The query after each command."""
        ...

    @property
    def read_back(self) -> tuple[SafeOrder, ...]:
        """The queries that show whether outputs are safe."""
        ...

    @property
    def identify(self) -> SafeOrder | None:
        """The identity query, sent before anything else, so that no other device is commanded."""
        ...

    @property
    def identity(self) -> Mapping[str, str] | None:
        """What the device answered to it earlier, if that is known."""
        ...

    @property
    def reply_ends(self) -> str:
        """The line end of answers."""
        ...

    @property
    def timeout(self) -> float:
        """The time allowed for an answer, s."""
        ...


class SafeStateRetries:
    """The attempts of one guard to make a device safe.

    Parameters
    ----------
    orders: the safe commands, and the port.
    clock: the clock for waits; real.
    open_port: opens the port again.
    ended: whether an end was requested, after which it tries once more.
    holding: the guard's token from `hold`; "" without one.
    """

    def __init__(
        self,
        orders: SafeStateSettings,
        clock: Clock,
        open_port: Callable[[], Port],
        ended: Callable[[], bool],
        holding: str = "",
    ) -> None:
        self._orders = orders
        self._clock = clock
        self._reply_ends = orders.reply_ends.encode("utf-8")
        self._open_port = open_port
        self._ended = ended
        self._holding = holding
        self._path = _path_of(orders.address.key)
        now = time.time()
        self._notice = Notice(
            uuid4().hex, orders.address.url, os.getpid(), now, now, identity=orders.identity
        )
        self._announced = False  # whether the notice was ever written
        self._rest = b""
        self._silent = False  # the newest exchange had no answer

    def carry_out(self, port: Port | None, *, known: bool = False) -> bool:
        """Try until the device confirms; return False if another program takes over, or after `LASTS` s.

        Parameters
        ----------
        port: if it is still open.
        known: whether its device has just been identified. After any failure it is identified again: on a
            port that stays open, or behind a network address, there may be another one by then.
        """
        give_up = time.monotonic() + LASTS
        pause = _FIRST_PAUSE
        self._announce()  # for any program that opens the port meanwhile
        while True:
            try:
                if self._taken_over():
                    raise _TakenOver
                # A port that was just opened may lead to any device.
                if port is None:
                    port, known = self._open_port(), False
                if not known:
                    self._require_same(port)
                elif self._orders.identify is None:
                    # The guard has sent its commands without waiting: their answers, which may be the echo of
                    # a state that is read below, must not be taken for those to the same commands now.
                    self._drop_late(port, self._orders.timeout)
                # Whatever was known counts for one attempt.
                known = False
                self._make_safe(port)
            except _TakenOver:
                _close(port)
                return False
            except (PortLost, RigctlError) as error:
                # A silent device keeps its port (opening it again would restart some boards); another device,
                # or a port that is gone, does not.
                if isinstance(error, PortLost) and port is not None and not isinstance(error, _Mute):
                    port.close()
                    port = None
                self._say(str(error), given_up=time.monotonic() >= give_up)
            else:
                self._withdraw()
                _close(port)
                return True
            if time.monotonic() >= give_up or not self._pause(pause):
                _close(port)
                return False
            pause = min(2.0 * pause, _LONGEST_PAUSE)

    def _require_same(self, port: Port) -> None:
        """Require the identity of the device; the port is released if another device is on it."""
        orders = self._orders
        # An answer that did not come in the attempt before, which failed for it, may still come.
        if self._silent:
            self._drop_late(port, orders.timeout)
        if orders.identify is None:
            return
        try:
            # A wrong answer is another device's; no answer may come from a device that is still starting.
            found = self._exchange(port, orders.identify)
        except _Mute as error:
            if self._silent:
                raise
            raise AnotherDevice(str(error)) from None
        if orders.identity is not None and found != orders.identity:
            raise AnotherDevice(f"another device is there: {', '.join(found.values())}")

    def _make_safe(self, port: Port) -> None:
        """Send all commands, even if some of them fail, read the outputs back, and identify the device again,
        since another one may have taken its place meanwhile."""
        trouble: _Mute | None = None
        for order in self._orders.safe:
            try:
                self._exchange(port, order)
                self._confirm(port, order)
            except _Mute as error:
                trouble = trouble or error
        for order in self._orders.read_back:
            try:
                self._exchange(port, order)
            except _Mute as error:
                trouble = trouble or error
        if trouble is not None:
            raise trouble
        self._require_same(port)

    def _confirm(self, port: Port, order: SafeOrder) -> None:
        """Query whether the device has refused a command, until it has no more errors to report."""
        confirm, refused = self._orders.confirm, ""
        if confirm is None:
            return
        for _ in range(_MOST_ERRORS):
            try:
                self._exchange(port, confirm)
                break
            except _Mute as error:
                if self._silent:
                    raise
                refused = refused or str(error)
        if refused:
            raise _Mute(f"after {order.shown!r}: {refused}")

    def _exchange(self, port: Port, order: SafeOrder) -> dict[str, str]:
        """Send one line and read its answer, if it has one; return the texts in it."""
        from rigctl.rig.protocols.line_pattern import reply_pattern, says

        texts: dict[str, str] = {}
        self._silent = False
        # Late answers of earlier exchanges must not be taken for the answer to this one.
        self._drop_late(port, 0.0)
        port.write(order.text)
        deadline = self._clock.now() + self._orders.timeout
        for pattern in map(reply_pattern, order.reply):
            line = self._line(port, deadline)
            found = pattern.match(line)
            if found is None:
                raise _Mute(f"{line!r} is no answer to {order.shown!r}")
            texts |= found
            for name, meant in order.values.items():
                if name in found and not any(says(found[name], text) for text in meant):
                    raise _Mute(
                        f"the device says {found[name]!r} to {order.shown!r} where {meant[0]!r} was commanded"
                    )
        return texts

    def _drop_late(self, port: Port, silence: float) -> None:
        """Discard what arrives until nothing has for `silence` s, or for as long as a device may send."""
        give_up = self._clock.now() + silence + _LONGEST_NOISE
        until = self._clock.now() + silence
        for _ in range(_MOST_READS):
            if self._taken_over():
                raise _TakenOver
            now = self._clock.now()
            if port.read(min(until, now + _LOOK)):
                until = min(self._clock.now() + silence, give_up)
            elif now >= until:
                break
        self._rest = b""

    def _line(self, port: Port, deadline: float) -> str:
        while self._reply_ends not in self._rest:
            if self._taken_over():
                raise _TakenOver
            if self._clock.now() >= deadline:
                self._silent = True
                raise _Mute("the device does not answer")
            self._rest += port.read(self._clock.now() + _LOOK)
        line, _, self._rest = self._rest.partition(self._reply_ends)
        return line.decode("utf-8", "replace").strip()

    def _pause(self, length: float) -> bool:
        """Wait before the next attempt; return False if another program has taken over."""
        end = time.monotonic() + length
        while time.monotonic() < end:
            if self._ended() or self._taken_over():
                return False
            time.sleep(_LOOK)
        return not self._taken_over()

    def _say(self, trouble: str, *, given_up: bool) -> None:
        self._notice = replace(
            self._notice,
            newest=time.time(),
            attempts=self._notice.attempts + 1,
            trouble=trouble,
            given_up=given_up,
        )
        self._announce()

    def _announce(self) -> None:
        if not self._announced or not self._taken_over():
            self._announced = _write(self._path, self._notice) or self._announced

    def _taken_over(self) -> bool:
        """Return whether another program has removed or replaced the notice, or has since opened the port.

        A notice that could not be written, or cannot be read, does not count as removed.
        """
        # First the record of who has opened the port, which also holds where no notice could be written.
        if self._holding and _held_by_another(self._orders.address.key, self._holding):
            return True
        if not self._announced:
            return False
        found = _read(self._path)
        if found is not None:
            return found.token != self._notice.token
        # A folder that is gone altogether shows nothing: a disk may have been unmounted.
        return self._path.parent.is_dir() and not self._path.exists()

    def _withdraw(self) -> None:
        found = _read(self._path)
        if found is not None and found.token == self._notice.token:
            with suppress(OSError):
                self._path.unlink()


def _close(port: Port | None) -> None:
    if port is not None:
        port.close()


class _TakenOver(Exception):
    """Another program has opened the port; its commands take precedence."""


class _Mute(PortLost):
    """The device does not confirm; the port stays open."""


def hold(key: str) -> str:
    """Record that this process has opened a port, which stops earlier guards; return the record's token."""
    token = f"{os.getpid()} {uuid4().hex}"
    path = _holder_of(key)
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(token, encoding="utf-8")
    return token


def let_go(key: str, token: str) -> None:
    """Remove the record of `hold`, unless another process has opened the port since."""
    path = _holder_of(key)
    with suppress(OSError):
        if read_text(path) == token:
            path.unlink()


def _held_by_another(key: str, token: str) -> bool:
    try:
        found = read_text(_holder_of(key))
        pid = int(found.partition(" ")[0])
    except (OSError, ValueError):
        return False
    return found != token and process_exists(pid)


def _holder_of(key: str) -> Path:
    return _path_of(key).with_suffix(".holder")


def retrying_guards() -> list[Notice]:
    """Return the notices of guards on this computer that are trying to make a device safe, or gave up."""
    return sorted(_found(), key=lambda notice: notice.since)


def take_over(key: str) -> Notice | None:
    """End a guard's attempts on a port, which the caller takes over; return its notice, if there is one.

    `key` is that of the port's `Address`.
    """
    path = _path_of(key)
    found = _read(path)
    with suppress(OSError):
        path.unlink()
    return found


def _found() -> Iterator[Notice]:
    with suppress(OSError):
        for path in _folder().glob("*.json"):
            notice = _read(path)
            if notice is not None:
                yield notice


def _path_of(key: str) -> Path:
    return _folder() / f"{file_name(key)}.json"


def _folder() -> Path:
    from platformdirs import user_state_path

    return user_state_path("rigctl", appauthor=False) / "guards"


def _read(path: Path) -> Notice | None:
    try:
        notice = Notice(**parse_json(read_text(path)))
        str(notice)  # raises if a value has another type
    except (OSError, ValueError, TypeError, AttributeError, OverflowError):
        return None
    return notice


def _write(path: Path, notice: Notice) -> bool:
    """Write a notice; return False if that fails, which must not keep the guard from making a device safe."""
    draft = path.with_suffix(".tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_text(json.dumps(asdict(notice)), encoding="utf-8", newline="\n")
        replace_file(draft, path)
    except OSError:
        return False
    return True
