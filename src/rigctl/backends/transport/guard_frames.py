"""Frames between rigctl and its guard: a letter, a length of four bytes, and the content."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from enum import Enum

_HEAD = struct.Struct("!cI")
_LONGEST = 1 << 20  # longest valid frame, bytes


class Frame(Enum):
    """The kind of a frame."""

    CONFIGURE = b"c"  #: to the guard: port, safe commands, watchdog, as JSON
    WRITE = b"w"  #: to the guard: bytes for the device
    ALIVE = b"a"  #: to the guard: rigctl's loop is running
    IDENTIFIED = b"i"  #: to the guard: the device is the right one; with its identity, as JSON
    EXCHANGED = b"s"  #: to the guard: another device is on the port by now
    RESUME = b"r"  #: to the guard: rigctl knows that the guard has made outputs safe
    CLOSE = b"x"  #: to the guard: release the port; with the state of the outputs, see `Outputs`
    OPENED = b"o"  #: from the guard: the port is open
    REFUSED = b"e"  #: from the guard: the port cannot be opened, and why, as JSON
    DATA = b"d"  #: from the guard: bytes from the device
    LOST = b"l"  #: from the guard: the port is gone, and why
    ACTED = b"t"  #: from the guard: it has made outputs safe; with the duration of the silence, s


class FrameReader:
    """Parses bytes into frames."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[tuple[Frame, bytes]]:
        """Return the frames completed by `data`."""
        self._rest += data
        while len(self._rest) >= _HEAD.size:
            letter, length = _HEAD.unpack_from(self._rest)
            end = _HEAD.size + length
            if length > _LONGEST:
                raise ConnectionError("not a frame")
            if len(self._rest) < end:
                return
            content, self._rest = self._rest[_HEAD.size : end], self._rest[end:]
            yield Frame(letter), content


def send_frame(connection: socket.socket, frame: Frame, content: bytes = b"") -> None:
    """Send a complete frame."""
    connection.sendall(_HEAD.pack(frame.value, len(content)) + content)
