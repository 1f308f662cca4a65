"""How often a serial line can carry a sample, from its baud rate and the characters of a sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from rigctl.backends.transport.address_key import is_serial_line
from rigctl.rig import Rig
from rigctl.rig.protocols.lines import Lines
from rigctl.rig.protocols.modbus import BITS, Modbus
from rigctl.rig.rates import BAUDS

#: of a sample in the stream of rigctl's own board, see docs/reference/board-protocol.md
_BOARD_CHARACTERS: Final = 36
#: of an RTU request, and of an answer without its values: unit, function, address and count, or count; CRC
_RTU_REQUEST: Final = 8
_RTU_ANSWER: Final = 5
#: characters of silence after both, by which their ends are recognised: 3.5 each
_RTU_SILENCE: Final = 7


@dataclass(frozen=True)
class LineCapacity:
    """The highest rate at which a line carries samples.

    Parameters
    ----------
    characters: in a sample, at least; requests and answers share the line, since they take turns.
    baud: bits per second.
    bits: per character, with its start, parity and stop bits.
    """

    characters: int
    baud: int
    bits: int

    @property
    def fastest(self) -> float:
        """``baud / (characters · bits)``, Hz."""
        return self.baud / (self.characters * self.bits)

    def __str__(self) -> str:
        """The reason for a refusal."""
        return (
            f"the line carries {self.fastest:.3g} Hz at most: at {self.baud} baud, "
            f"with {self.characters} characters or more for a sample"
        )


def line_capacity(rig: Rig, kind: str, options: Mapping[str, object]) -> LineCapacity | None:
    """The capacity of a bench's line; None if it is on no serial line, or nothing is known of it.

    Parameters
    ----------
    kind: of the backend.
    options: ``port`` and ``baud``, where they are other than in the rig file.
    """
    baud = options.get("baud") or rig.backend.baud or BAUDS.get(kind)
    port = options.get("port") or rig.backend.port
    if (
        kind not in BAUDS
        or not isinstance(baud, int)
        or (isinstance(port, str) and not is_serial_line(kind, port))
    ):
        return None
    lines, modbus = rig.backend.lines, rig.backend.modbus
    if kind == "modbus":
        return None if modbus is None or port is None else _of_registers(modbus, baud)
    if kind == "visa" and port is None:
        return None
    if lines is not None:
        return LineCapacity(_characters(lines), baud, _bits(lines.frame))
    return LineCapacity(_BOARD_CHARACTERS, baud, _bits("8N1"))


def _bits(frame: str) -> int:
    """Bits of a character in a frame like ``8N1``, with its start bit."""
    return 1 + int(frame[0]) + (frame[1] != "N") + int(frame[2])


def _characters(lines: Lines) -> int:
    """Characters of the queries made for each sample and of their answers; a number has one at least."""
    # Only the least number of characters is known (a number has one digit or more), so that the capacity is
    # an upper bound: a rate above it is impossible, one below it may still be.
    count = 0
    for query in lines.queries:
        if query.every is not None:
            continue
        count += len(query.send) + len(lines.send_ends)
        for pattern in query.patterns:
            numbers = sum(place != "_" for place in pattern.places)
            count += sum(map(len, pattern.literals)) + numbers + len(lines.reply_ends)
    return count


def _of_registers(modbus: Modbus, baud: int) -> LineCapacity:
    blocks = [block for block in modbus.blocks if block.every is None]
    values = sum((block.count + 7) // 8 if block.table in BITS else 2 * block.count for block in blocks)
    characters = (_RTU_REQUEST + _RTU_ANSWER + _RTU_SILENCE) * len(blocks) + values
    return LineCapacity(characters, baud, _bits(modbus.frame))
