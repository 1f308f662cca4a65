"""Makes an unreachable device safe: repeats the safe commands until the device confirms them.

A guard does this after rigctl has ended with outputs that may be on. A small file in the user's state folder,
the notice, reports it to `rigctl doctor`, `monitor` and `off`; a program that opens the port removes the
file, which ends the guard.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Protocol
from uuid import uuid4

from rigctl.backends.processes import process_exists
from rigctl.backends.transport.port import Port, PortLost
from rigctl.backends.transport.safe_commands import SafeOrder
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.files.regular import read_text
from rigctl.files.write import replace_file
from rigctl.json_values import parse_json

LASTS = 24 * 3600.0  #: s, after which the guard gives up
_FIRST_PAUSE, _LONGEST_PAUSE = 0.1, 5.0  # s between two attempts; doubled each time
_LOOK = 0.05  # s between two checks whether another program has taken over the port
_ANSWER = 0.5  # s for an answer
_OLD = 60.0  # s without a report after which it is unknown whether a guard is still trying


@dataclass(frozen=True)
class Notice:
    """A guard's report of its attempts: the port, since when, how many, and why they fail.

    `since` and `newest` are calendar times in s; `given_up` is true once it has stopped trying.
    """

    token: str
    port: str
    pid: int
    since: float
    newest: float
    attempts: int = 0
    trouble: str = ""
    given_up: bool = False

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
        return f"a guard (process {self.pid}) {what} to make outputs safe on {self.port}{trouble}"


class Orders(Protocol):
    """The part of a guard's orders that is used here."""

    @property
    def url(self) -> str:
        """The address of the port."""
        ...

    @property
    def safe(self) -> tuple[SafeOrder, ...]:
        """The safe commands."""
        ...

    @property
    def identify(self) -> SafeOrder | None:
        """The identity query, sent first on a reopened port, so that no other device is commanded."""
        ...

    @property
    def reply_ends(self) -> str:
        """The line end of answers."""
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
        orders: Orders,
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
        self._path = _path_of(orders.url)
        now = time.time()
        self._notice = Notice(uuid4().hex, orders.url, os.getpid(), now, now)
        self._announced = False  # whether the notice was ever written
        self._rest = b""

    def carry_out(self, port: Port | None) -> bool:
        """Try until the device confirms; return False if another program takes over, or after `LASTS` s."""
        give_up = time.monotonic() + LASTS
        pause, known = _FIRST_PAUSE, port is not None
        self._announce()  # for any program that opens the port meanwhile
        while True:
            try:
                if self._taken_over():
                    raise _TakenOver
                if port is None:
                    port, known = self._open_port(), False
                if not known:
                    self._require_same(port)
                    known = True
                self._make_safe(port)
            except _TakenOver:
                _close(port)
                return False
            except (PortLost, RigctlError) as error:
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
        if self._orders.identify is not None:
            self._exchange(port, self._orders.identify)

    def _make_safe(self, port: Port) -> None:
        for order in self._orders.safe:
            self._exchange(port, order)

    def _exchange(self, port: Port, order: SafeOrder) -> None:
        """Send one command and read its confirmation, if it has one."""
        from rigctl.rig.line_pattern import VALUE, read_number, reply_pattern

        while port.read(self._clock.now()):
            pass
        self._rest = b""
        port.write(order.text)
        deadline = time.monotonic() + _ANSWER
        for pattern in map(reply_pattern, order.reply):
            line = self._line(port, deadline)
            found = pattern.match(line)
            if found is None:
                raise _Mute(f"{line!r} is no answer to {order.text!r}")
            said = found.get(VALUE)
            if said is None or not order.value or said.casefold() == order.value.casefold():
                continue
            if read_number(said) is None or read_number(said) != read_number(order.value):
                raise _Mute(f"the device says {said!r} where {order.value!r} was commanded")

    def _line(self, port: Port, deadline: float) -> str:
        while self._reply_ends not in self._rest:
            if self._taken_over():
                raise _TakenOver
            if time.monotonic() >= deadline:
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
        if self._holding and _held_by_another(self._orders.url, self._holding):
            return True
        if not self._announced:
            return False
        found = _read(self._path)
        if found is not None:
            return found.token != self._notice.token
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


def hold(url: str) -> str:
    """Record that this process has opened a port, which stops earlier guards; return the record's token."""
    token = f"{os.getpid()} {uuid4().hex}"
    path = _holder_of(url)
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(token, encoding="utf-8")
    return token


def let_go(url: str, token: str) -> None:
    """Remove the record of `hold`, unless another process has opened the port since."""
    path = _holder_of(url)
    with suppress(OSError):
        if read_text(path) == token:
            path.unlink()


def _held_by_another(url: str, token: str) -> bool:
    try:
        found = read_text(_holder_of(url))
        pid = int(found.partition(" ")[0])
    except (OSError, ValueError):
        return False
    return found != token and process_exists(pid)


def _holder_of(url: str) -> Path:
    return _path_of(url).with_suffix(".holder")


def retrying_guards() -> list[Notice]:
    """Return the notices of guards on this computer that are trying to make a device safe, or gave up."""
    return sorted(_found(), key=lambda notice: notice.since)


def take_over(url: str) -> Notice | None:
    """End a guard's attempts on a port, which the caller takes over; return its notice, if there is one."""
    path = _path_of(url)
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


def _path_of(url: str) -> Path:
    from hashlib import sha256

    name = "".join(letter if letter.isalnum() else "-" for letter in url).strip("-")[-40:]
    return _folder() / f"{name}-{sha256(url.encode('utf-8', 'replace')).hexdigest()[:8]}.json"


def _folder() -> Path:
    from platformdirs import user_state_path

    return user_state_path("rigctl", appauthor=False) / "guards"


def _read(path: Path) -> Notice | None:
    try:
        notice = Notice(**parse_json(read_text(path)))
        str(notice)  # raises if a value has another type
    except (OSError, ValueError, TypeError, OverflowError):
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
