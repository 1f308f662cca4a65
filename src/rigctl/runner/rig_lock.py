"""A lock with owner, process and heartbeat: only one program at a time commands a bench.

The owner is written to a small file in the user's state folder. A program that finds a dead owner, or one
with an old heartbeat, takes the bench over; the former owner, if it was only suspended, notices and ends.

Two locks are involved, and they protect different things. The owner's file says who may command the
bench, for as long as a run takes; a lock of the operating system would not show who that is, and could
not be taken from a program that hangs. A `FileLock` beside it is held only while the file is read and
written, so that two programs cannot both find the bench free.

`RigLock` is for one address and is used by one thread; `BenchLock` takes those of all devices. Why addresses
and not names are locked: docs/decisions/0138-locks-are-on-addresses.md.
"""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self
from uuid import uuid4

from rigctl.backends.processes import process_exists
from rigctl.backends.transport.address_key import file_name
from rigctl.dataset.run_id import slug
from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.regular import read_text
from rigctl.files.write import replace_file
from rigctl.json_values import parse_json
from rigctl.runner.operators.requests import Order, Request

if TYPE_CHECKING:
    from rigctl.runner.snapshot import View

#: s without a heartbeat after which an owner counts as gone
OLD = 30.0
#: s between two heartbeats
_BEAT = 2.0
#: s for which a heartbeat waits, on Windows, for a reader of the last one; the run waits too
_PATIENCE = 0.05


@dataclass(frozen=True)
class Owner:
    """The program that commands a bench. `beat` is monotonic time on `host`, `date` calendar time, both in
    s."""

    token: str
    rig: str
    purpose: str
    host: str
    pid: int
    beat: float
    date: float
    run: str = ""  #: the folder of the run in progress, if any

    @property
    def alive(self) -> bool:
        """False if its process is gone, its computer was restarted, or its heartbeat is old.

        On this computer the age is measured in monotonic time: a step of the calendar clock neither removes a
        live owner nor keeps a dead one.
        """
        if self.host != platform.node():
            return abs(time.time() - self.date) < OLD
        # Negative after a restart of the computer, when monotonic time has begun again: the owner is gone.
        age = time.monotonic() - self.beat
        return 0.0 <= age < OLD and process_exists(self.pid)


class RigLock:
    """The right to command one bench, held while entered; also a control of the run that ends it when lost.

    Parameters
    ----------
    rig: the bench's name.
    purpose: what it is needed for, shown to others.
    folder: of the locks; by default the user's state folder.
    key: of the address of a real bench, see `rigctl.backends.transport.address.Address`. Two rig files with
        one address exclude each other, equal rig files with different addresses do not. A bench without an
        address is known by its name.
    at_any_cost: take it from its owner, and continue without it if it cannot be written: to make a bench
        safe. The owner notices at its next heartbeat, and ends.
    """

    def __init__(
        self, rig: str, purpose: str, folder: Path | None = None, *, key: str = "", at_any_cost: bool = False
    ) -> None:
        self._rig = rig
        self._purpose = purpose
        self._path = (folder or _state_folder()) / f"{file_name(key) if key else slug(rig)}.json"
        self._at_any_cost = at_any_cost
        self._token = uuid4().hex
        self._next_beat = 0.0
        self._lost = False
        self._held = False
        self._run: Path | None = None

    def __enter__(self) -> Self:
        """Take the lock.

        Raises
        ------
        RigctlError
            another program commands the bench; names it.
        """
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._guard():
                # Read and written under one guard: between the two no other program can take the bench.
                owner = read_owner(self._path)
                if owner is not None and owner.alive and not self._at_any_cost:
                    other = f", as '{owner.rig}'," if owner.rig != self._rig else ""
                    who = f"{owner.purpose} (process {owner.pid} on {owner.host})"
                    raise RigctlError(
                        f"'{self._rig}' is in use{other} by {who}",
                        hint="Wait until it ends, or end it with 'rigctl off'",
                        exit_code=ExitCode.FAILED,
                    )
                self._write()
        except OSError as problem:
            if self._at_any_cost:
                return self
            raise RigctlError(
                f"cannot lock the bench: {problem.strerror or problem}",
                where=Location(self._path),
                hint="Make that folder writable; without a lock two programs could command one bench",
                exit_code=ExitCode.FAILED,
            ) from problem
        # Only now: what was not taken must not be released.
        self._held = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release it; never raises."""
        if not self._held:
            return
        self._held = False
        with suppress(Exception), self._guard():
            owner = read_owner(self._path)
            # The file may belong to a program that has taken the bench over meanwhile.
            if owner is not None and owner.token == self._token:
                self._path.unlink()

    def poll(self) -> Sequence[Order]:
        """The order to end when another program has taken the bench over."""
        if self._lost:
            # Said once; the run ends by it.
            self._lost = False
            return (Order(Request.ABORT, "another program that has taken the bench over"),)
        return ()

    def acknowledge(self, order: Order, message: str) -> None:
        """Nothing to acknowledge."""

    def publish(self, view: View) -> None:
        """Beat when it is due."""
        self.beat()

    def beat(self) -> None:
        """Write the heartbeat when it is due, or notice that the bench was taken over."""
        now = time.monotonic()
        if not self._held or now < self._next_beat:
            return
        # Set before the attempt: a disk that refuses is tried again at the next beat, not at each call.
        self._next_beat = now + _BEAT
        with suppress(OSError), self._guard():  # a full disk must not end a run; the owner's process is seen
            owner = read_owner(self._path)
            # a file that is gone was taken over, and given back since
            gone = not self._path.exists()
            # Held no longer: nothing is written over the new owner, and `__exit__` leaves its file alone. A
            # file that cannot be read is none of these cases, and is written again.
            if gone or (owner is not None and owner.token != self._token):
                self._lost, self._held = True, False
            else:
                self._write()

    def close(self) -> None:
        """Nothing to do: `__exit__` releases the lock."""

    def take_for(self, run: Path) -> None:
        """Publish the folder of the run, so that others can ask it to end."""
        self._run = run
        self._next_beat = 0.0
        self.beat()

    def owner(self) -> Owner | None:
        """The owner of the bench; None if there is none."""
        owner = read_owner(self._path)
        return owner if owner is not None and owner.alive else None

    def _guard(self) -> Any:
        """A short lock while reading and writing the owner's file."""
        from filelock import FileLock

        return FileLock(self._path.with_suffix(".lock"), timeout=5.0)

    def _write(self) -> None:
        import json

        owner = Owner(
            token=self._token,
            rig=self._rig,
            purpose=self._purpose,
            host=platform.node(),
            pid=os.getpid(),
            beat=time.monotonic(),
            date=time.time(),
            run=str(self._run.absolute()) if self._run is not None else "",
        )
        # Replaced as a whole: `read_owner` of other programs takes no lock, and must never see half a file.
        draft = self._path.with_suffix(".tmp")
        draft.write_text(json.dumps(asdict(owner)), encoding="utf-8", newline="\n")
        replace_file(draft, self._path, _PATIENCE)


class BenchLock:
    """The right to command a bench: the lock of each of its addresses, all of them or none.

    Parameters
    ----------
    locks: one for each address.
    """

    def __init__(self, locks: Sequence[RigLock]) -> None:
        self._locks = locks
        self._held = ExitStack()

    def __enter__(self) -> Self:
        """Take all of them.

        Raises
        ------
        RigctlError
            another program commands one of the devices; names it.
        """
        # If one is in use, those already taken are released again before the error goes on.
        with ExitStack() as taken:
            for lock in self._locks:
                taken.enter_context(lock)
            self._held = taken.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release them; never raises."""
        self._held.close()

    def poll(self) -> Sequence[Order]:
        """The order to end when another program has taken over the bench, or one of its devices."""
        return [order for lock in self._locks for order in lock.poll()][:1]

    def acknowledge(self, order: Order, message: str) -> None:
        """Nothing to acknowledge."""

    def publish(self, view: View) -> None:
        """Beat when it is due."""
        self.beat()

    def beat(self) -> None:
        """As `RigLock.beat`."""
        for lock in self._locks:
            lock.beat()

    def close(self) -> None:
        """Nothing to do: `__exit__` releases the locks."""

    def take_for(self, run: Path) -> None:
        """Publish the folder of the run, so that others can ask it to end."""
        for lock in self._locks:
            lock.take_for(run)

    def owners(self) -> list[Owner | None]:
        """The owner of each address; None if there is none."""
        return [lock.owner() for lock in self._locks]


def owners(rig: str, folder: Path | None = None) -> list[Owner]:
    """The programs that command benches of a name, at whatever addresses."""
    found = (read_owner(path) for path in sorted((folder or _state_folder()).glob("*.json")))
    return [owner for owner in found if owner is not None and owner.alive and owner.rig == rig]


def read_owner(path: Path) -> Owner | None:
    """The owner in a lock file; None if there is none or it cannot be read."""

    try:
        fields = parse_json(read_text(path))
        owner = Owner(**fields)
        texts = (owner.token, owner.rig, owner.purpose, owner.host, owner.run)
        numbers = (owner.pid, owner.beat, owner.date)
    except (OSError, ValueError, TypeError):
        return None
    typed = all(isinstance(text, str) for text in texts) and isinstance(owner.pid, int)
    plain = all(isinstance(number, int | float) and math.isfinite(number) for number in numbers)
    return owner if typed and plain else None


def _state_folder() -> Path:
    from platformdirs import user_state_path

    return user_state_path("rigctl", appauthor=False) / "locks"
