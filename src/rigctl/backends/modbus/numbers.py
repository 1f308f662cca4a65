"""Numbers in 16-bit registers: their type, byte and word order, and scale.

Imports little, since every guard of a Modbus device loads it when it starts.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigctl.backends.transport.readback import repeats

_FORMATS: Mapping[str, str] = {
    "int16": ">h",
    "uint16": ">H",
    "int32": ">i",
    "uint32": ">I",
    "float32": ">f",
    "int64": ">q",
    "uint64": ">Q",
    "float64": ">d",
}
#: smallest normalised magnitude of each type
_SMALLEST: Mapping[str, float] = {"float32": 2.0**-126, "float64": 2.0**-1022}
_DIGITS: Mapping[str, str] = {"float32": ".7e", "float64": ".15e"}


@dataclass(frozen=True)
class Place:
    """The location and format of a number; JSON-compatible, so that it can be passed to a guard.

    Parameters
    ----------
    table: ``coil``, ``discrete``, ``input`` or ``holding``.
    address: from 0.
    kind: `rigctl.rig.protocols.modbus.NumberType`.
    swap_bytes, swap_words: whether the order of bytes or words is little-endian.
    scale, offset: number = register * scale + offset.
    invalid: content of the register for a missing value; None if there is always a value.
    """

    table: str
    address: int
    kind: str
    swap_bytes: bool
    swap_words: bool
    scale: float
    offset: float
    invalid: int | None

    @property
    def width(self) -> int:
        """Number of registers, or bits."""
        return 1 if self.is_bit else struct.calcsize(_FORMATS[self.kind]) // 2

    @property
    def is_bit(self) -> bool:
        """Whether this is a coil or a discrete input."""
        return self.kind == "bool"

    def text(self, words: Sequence[int]) -> str:
        """Return the number as text, with all its digits; ``nan`` for a missing value.

        A value is missing if the register has the content `invalid`, or if it is a denormalised number, such
        as a pressure of 1e-40 bar from the wrong byte or word order: no measurement is that small, and an
        interlock would take it for zero.
        """
        found = self._unpacked(words)
        if isinstance(found, float):
            missing = 0.0 < abs(found) < _SMALLEST[self.kind]
        else:
            missing = found == self.invalid
        if missing:
            return "nan"
        if self.is_bit:
            return str(found)
        return format(float(found * self.scale + self.offset), _DIGITS.get(self.kind, ".15e"))

    def repeats(self, words: Sequence[int], number: float) -> bool:
        """Return whether registers have a number that was written to others, as these round."""
        found = self._unpacked(words)
        number_here = not self.is_bit and found != self.invalid
        return number_here and repeats(found, self.scale, self.offset, number)

    def number(self, words: Sequence[int]) -> float:
        """Return the number that registers have."""
        return float(self._unpacked(words) * self.scale + self.offset)

    def words(self, number: float) -> list[int]:
        """Return the registers for a number.

        Raises
        ------
        ValueError
            the number is out of the range of its type.
        """
        raw = (number - self.offset) / self.scale
        if not math.isfinite(raw):
            raise ValueError(f"{number:g} is no number that can be written")
        if self.is_bit:
            return [int(round(raw) != 0)]
        try:
            packed = struct.pack(_FORMATS[self.kind], raw if self.kind in _DIGITS else round(raw))
        except (struct.error, OverflowError):
            raise ValueError(f"{number:g} does not fit into {self.kind}") from None
        return self._ordered([int.from_bytes(packed[at : at + 2]) for at in range(0, len(packed), 2)])

    def _unpacked(self, words: Sequence[int]) -> Any:
        if self.is_bit:
            return int(words[0])
        packed = b"".join(word.to_bytes(2) for word in self._ordered(words))
        return struct.unpack(_FORMATS[self.kind], packed)[0]

    def _ordered(self, words: Sequence[int]) -> list[int]:
        """Return the words with bytes or words swapped as configured; its own inverse."""
        found = [(word & 0xFF) << 8 | word >> 8 for word in words] if self.swap_bytes else list(words)
        return found[::-1] if self.swap_words else found
