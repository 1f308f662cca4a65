"""What goes between rigctl and its guard: a letter, a length of four bytes, and the content."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from enum import Enum

_HEAD = struct.Struct("!cI")
_LONGEST = 1 << 20  # bytes; more is no frame of ours


class Frame(Enum):
    """What a frame says."""

    CONFIGURE = b"c"  #: to the guard: port, safe commands, watchdog, as JSON
    WRITE = b"w"  #: to the guard: bytes for the device
    ALIVE = b"a"  #: to the guard: rigctl's loop goes round
    RESUME = b"r"  #: to the guard: rigctl knows that it has acted
    CLOSE = b"x"  #: to the guard: let the port go; in which state the outputs are, see `Duty`
    OPENED = b"o"  #: from the guard: the port is open
    REFUSED = b"e"  #: from the guard: it cannot be opened, and why, as JSON
    DATA = b"d"  #: from the guard: bytes of the device
    LOST = b"l"  #: from the guard: the port is gone, and why
    ACTED = b"t"  #: from the guard: it has made outputs safe; after how many s of silence


class FrameReader:
    """Bytes in, frames out."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[tuple[Frame, bytes]]:
        """The frames that are complete with `data`."""
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
    """Send a frame whole."""
    connection.sendall(_HEAD.pack(frame.value, len(content)) + content)
