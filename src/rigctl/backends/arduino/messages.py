"""The board's lines: each ends with LF and carries the CRC-16/XMODEM of the text before its ``*``."""

from __future__ import annotations

from binascii import crc_hqx
from dataclasses import dataclass
from typing import TypeAlias

_LONGEST = 512  # longest line, bytes


@dataclass(frozen=True, slots=True)
class Reading:
    """One line of the stream.

    Parameters
    ----------
    sequence: its number, modulo 2^16.
    board_us: the board's microseconds, modulo 2^32.
    counts: A0, A1, A2.
    outputs: bit 0 heater, 1 extend, 2 retract, 3 PWM.
    trips: the latched causes.
    pwm: PWM counts while a closed loop runs on the board; otherwise None.
    held_us: time since `pwm` last changed, µs.
    """

    sequence: int
    board_us: int
    counts: tuple[int, int, int]
    outputs: int
    trips: int
    pwm: int | None = None
    held_us: int = 0


@dataclass(frozen=True, slots=True)
class Switched:
    """An event on the board at an exact time: ``H`` (heater), ``V`` (valve), ``P`` (PWM) or ``T`` (trip)."""

    number: int
    board_us: int
    kind: str
    value: int


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a tagged command: `text` is ``OK``, a value, or ``!number,"text"``."""

    tag: int
    text: str


Message: TypeAlias = Reading | Switched | Reply


class LineReader:
    """Parses bytes into messages; may start in the middle of a line, and counts and skips damaged lines."""

    def __init__(self) -> None:
        self._rest = b""
        self._synchronised = False  # the first line may be incomplete: it began before the port was opened
        self.damaged = 0  #: running count of damaged lines

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages completed by `data`."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _LONGEST:
            self._rest = self._rest[-_LONGEST:]
        messages: list[Message] = []
        for line in lines:
            message = parse_line(line)
            if message is not None:
                messages.append(message)
            elif line.strip() and self._synchronised:
                self.damaged += 1
            self._synchronised = True
        return messages


def with_checksum(text: str) -> bytes:
    """Return a command with its checksum and line end, as bytes."""
    body = text.encode("ascii")
    return b"%s*%04X\n" % (body, crc_hqx(body, 0))


def parse_line(line: bytes) -> Message | None:
    """Return the message in a line without its LF; None if it is damaged or of another kind."""
    body, star, checksum = line.rpartition(b"*")
    if not star or not body or len(checksum) != 4:
        return None
    try:
        if int(checksum, 16) != crc_hqx(body, 0):
            return None
        text = body.decode("ascii")
        return _parse(text[0], text[1:])
    except ValueError:
        return None


def _parse(kind: str, text: str) -> Message | None:
    if kind == "@":
        sequence, micros, a0, a1, a2, outputs, trips, *loop = map(int, text.split(","))
        if len(loop) not in (0, 2):
            return None
        return Reading(sequence, micros, (a0, a1, a2), outputs, trips, *loop)
    if kind == "!":
        number, at, what, value = text.split(",")
        return Switched(int(number), int(at), what, int(value))
    if kind == "#":
        tag, _, answer = text.partition(" ")
        return Reply(int(tag), answer)
    return None
