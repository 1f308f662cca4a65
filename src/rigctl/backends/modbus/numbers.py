"""Numbers in registers of 16 bits: their type, their byte and word order, their scale.

Light on purpose: a guard starts with it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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
#: below these the mantissa is not normalised
_SMALLEST: Mapping[str, float] = {"float32": 2.0**-126, "float64": 2.0**-1022}
_DIGITS: Mapping[str, str] = {"float32": ".8g", "float64": ".16g"}


@dataclass(frozen=True)
class Place:
    """Where a number stands and how; nothing but what JSON holds, so that a guard can be given it.

    Parameters
    ----------
    table: ``coil``, ``discrete``, ``input`` or ``holding``.
    address: from 0.
    kind: `rigctl.rig.modbus.NumberType`.
    swap_bytes, swap_words: where the order is little.
    scale, offset: number = register * scale + offset.
    invalid: what the register holds while there is no value; None where it always has one.
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
        """Registers, or bits, that it takes."""
        return 1 if self.is_bit else struct.calcsize(_FORMATS[self.kind]) // 2

    @property
    def is_bit(self) -> bool:
        """Whether it is a coil or a discrete input."""
        return self.kind == "bool"

    def text(self, words: Sequence[int]) -> str:
        """The number that stands there, as text; ``nan`` where there is none.

        That is where the device says so, and where bytes or words in the wrong order would have made a
        pressure of 1e-40 bar: nothing is measured so small, and an interlock would take it for nought.
        """
        found = self._unpacked(words)
        if isinstance(found, float):
            if 0.0 < abs(found) < _SMALLEST[self.kind]:
                return "nan"
            number = found * self.scale + self.offset
        elif found == self.invalid:
            return "nan"
        elif self.scale == 1.0 and self.offset == 0.0:
            return str(found)
        else:
            number = found * self.scale + self.offset
        return format(number, _DIGITS.get(self.kind, ".12g"))

    def words(self, number: float) -> list[int]:
        """A number as it is written there.

        Raises
        ------
        ValueError
            it does not fit.
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
        """The words in the other order than they are in, which is the same both ways."""
        found = [(word & 0xFF) << 8 | word >> 8 for word in words] if self.swap_bytes else list(words)
        return found[::-1] if self.swap_words else found
