"""The emulated board on a pseudo-terminal, which any client can open as a serial port."""

from __future__ import annotations

import errno
import os
import select
import sys
from pathlib import Path

from rigctl.backends.emulated.board import SLICE, EmulatedBoard
from rigctl.clock import Clock
from rigctl.errors import Location, RigctlError

_BAUD_TOLERANCE = 0.045  # relative tolerance of a receiver's baud rate
_FARTHEST_BEHIND = 2.0  # longest delay of a busy computer that is made up for, s


class PtyBridge:
    """Passes bytes between a pseudo-terminal and a board, both following a clock.

    Unread data are lost, as on a wire. A client with a different baud rate receives and sends garbage.

    Parameters
    ----------
    board: the board at the other end.
    clock: real time, or faster.

    Attributes
    ----------
    port: the path that a client opens.
    """

    def __init__(self, board: EmulatedBoard, clock: Clock) -> None:
        if sys.platform == "win32":  # pragma: no cover - simavr fails earlier
            raise NotImplementedError
        import tty

        self._board = board
        self._clock = clock
        self._ahead = board.time - clock.now()
        self._master, slave = os.openpty()
        tty.setraw(slave)  # otherwise the terminal would echo answers back as commands
        self.port = os.ttyname(slave)
        self._named: Path | None = None
        os.close(slave)  # so that a hang-up of the master end shows that no client has the port open
        os.set_blocking(self._master, False)
        self._speeds = _speeds()
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)

    def step(self) -> None:
        """Advance one slice."""
        # One slice: what the client has sent goes in, the board runs, what it sends comes out. A byte is thus
        # late by a slice at most.
        client = self._has_client()
        received = self._read() if client else b""
        sound = self._sound_baud() if client else True
        if received:
            self._board.avr.send(received if sound else _garbled(received))
        self._board.run_to(self._board.time + SLICE)
        sent = self._board.avr.take()
        if sent and client:
            self._write(sent if sound else _garbled(sent))
        self._keep_pace()

    def close(self) -> None:
        """Remove the port, as if the board were unplugged."""
        os.close(self._master)

    def link(self, path: Path) -> None:
        """Make a symbolic link to the port.

        Raises
        ------
        RigctlError
            a file exists; only a stale link of an earlier port is replaced.
        """
        if path.is_symlink() and path.readlink().parent == Path(self.port).parent:
            path.unlink()
        try:
            path.symlink_to(self.port)
        except FileExistsError:
            raise RigctlError(
                "there is a file already", where=Location(path), expected="a new name for the port"
            ) from None
        self._named = path

    def unlink(self) -> None:
        """Remove the link if it still points to this port."""
        name, self._named = self._named, None
        if name is not None and name.is_symlink() and str(name.readlink()) == self.port:
            name.unlink()

    def _keep_pace(self) -> None:
        due = self._board.time - self._ahead
        late = self._clock.now() - due
        # A computer that stood still: this is not made up for, as it would run the board many times too fast.
        if late > _FARTHEST_BEHIND:
            self._ahead -= late
        else:
            self._clock.sleep_until(due)

    def _has_client(self) -> bool:
        events = self._poll.poll(0)
        return not (events and events[0][1] & select.POLLHUP)

    def _read(self) -> bytes:
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno == errno.EIO:  # the client has just gone
                return b""
            raise

    def _write(self, data: bytes) -> None:
        try:
            os.write(self._master, data)
        except (BlockingIOError, OSError):
            return  # full, or the client has just gone: lost, as on a wire

    def _sound_baud(self) -> bool:
        """Return whether the client's baud rate is the board's; both ends of a pty share their settings."""
        import termios

        set_to = self._speeds.get(termios.tcgetattr(self._master)[5])
        return not set_to or abs(set_to - self._board.avr.baud) <= _BAUD_TOLERANCE * self._board.avr.baud


def _speeds() -> dict[int, int]:
    """Return the baud rate by the system's speed code."""
    import termios

    names = (name for name in dir(termios) if name[0] == "B" and name[1:].isdigit())
    return {getattr(termios, name): int(name[1:]) for name in names}


def _garbled(data: bytes) -> bytes:
    """Return the data as received at another baud rate."""
    return bytes((byte * 37 + 11) & 0xFF for byte in data)
