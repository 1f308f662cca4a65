"""Numbers and missing values in a cell.

In: the text of a cell, and the decimal sign of its file. Out: a number, NaN for a missing value, or None
for what is neither, which makes its row a bad one. The sign is found once for a file, by the majority of
its first cells, since a single text may look like a number.

The care is for one mistake: a sign taken for the wrong one makes a value wrong by a factor of 1000, and a
fit would believe it. `1.020,5` has one meaning and is read. `1.011` in a column with `978` has two;
whether another cell settles it is known only at the end of the file (`Thousands`), and where none does
the file is refused until `--decimal` is given.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from rigctl.dataset.importing.cells.missing_values import NO_VALUE
from rigctl.errors import Location, RigctlError

_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
#: thousands in groups of three with a decimal sign, which is unambiguous
_GROUPED: Final = re.compile(r"[+-]?\d{1,3}([.,' \u00a0\u2009\u202f])\d{3}(\1\d{3})*[.,]\d+")
#: groups whose separator cannot be a decimal sign
_SPACED: Final = re.compile(r"[+-]?\d{1,3}(['\u00a0\u2009\u202f ]\d{3})+")
_POINT: Final = re.compile(r"[+-]?(\d{1,3}(,\d{3})+|\d*)\.\d+([eE][+-]?\d+)?")
_COMMA: Final = re.compile(r"[+-]?(\d{1,3}(\.\d{3})+|\d*),\d+([eE][+-]?\d+)?")
_THOUSANDS: Final = {
    ",": re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?"),
    ".": re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d*)?"),
}
_THREE: Final = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_WHOLE: Final = re.compile(r"[+-]?\d{1,3}")
_LONG: Final = re.compile(r"[+-]?\d{4,}")


class Thousands:
    """Whether a sign in the numbers of a file is the decimal one, from all of its cells.

    In a column with ``978`` and ``1.011`` it may separate thousands, unless a number of the file shows that
    it does not, such as ``0.5``, or one of the column lacks a separator, such as ``1500``.
    """

    def __init__(self, sign: str) -> None:
        mark = re.escape(sign)
        self._three = re.compile(rf"[+-]?[1-9]\d{{0,2}}{mark}\d{{3}}")
        self._decimal = re.compile(rf"[+-]?\d*{mark}\d*([eE][+-]?\d+)?")
        self._sign = sign
        self.settled = False  #: it is the decimal sign
        self.others = 0  #: cells that are no numbers
        self._threes: dict[int, tuple[int, str]] = {}
        self._wholes: dict[int, str] = {}
        self._long: set[int] = set()

    def take(self, columns: Mapping[int, Sequence[str]], lines: Sequence[int]) -> None:
        """Look at the cells of some rows, column by column."""
        for index, cells in columns.items():
            for line, cell in zip(lines, cells, strict=False):
                if self._sign not in cell:
                    if _WHOLE.fullmatch(cell):
                        self._wholes.setdefault(index, cell)
                    elif _LONG.fullmatch(cell):
                        self._long.add(index)
                    else:
                        self.others += cell not in NO_VALUE
                elif self._three.fullmatch(cell):
                    self._threes.setdefault(index, (line, cell))
                elif self._decimal.fullmatch(cell) and len(cell.strip("+-")) > 1:
                    # A single number that cannot be thousands shows what the sign is, in the whole file.
                    self.settled = True
                    return
                else:
                    self.others += 1

    def ambiguous(self) -> tuple[int, int, str, str] | None:
        """Return the index of a column, a line, its number, and a whole number; None if all is clear."""
        if self.settled:
            return None
        for index, (line, cell) in sorted(self._threes.items()):
            if index in self._wholes and index not in self._long:
                return index, line, cell, self._wholes[index]
        return None


def ambiguous_sign(name: str, cell: str, whole: str, sign: str, where: Location) -> RigctlError:
    """Return the refusal of a column with a number whose sign may be the decimal one or separate thousands.

    Parameters
    ----------
    name, cell, whole, where: of the column, its number, a whole number of it, and the place of the first.
    """
    other = "," if sign == "." else "."
    return RigctlError(
        f"{name}: a decimal sign, or one between thousands?",
        value=f"{cell} beside {whole}",
        expected=f"--decimal '{sign}' ({cell.replace(sign, '.')}), or --decimal '{other}' "
        f"({cell.replace(sign, '')})",
        where=where,
    )


def comma_remark(cell: str) -> str:
    """Return the remark on numbers such as ``1,234``, which might be whole."""
    return f"numbers such as {cell} are read with a decimal comma; --decimal . reads thousands"


def find_decimal(cells: Sequence[str]) -> tuple[str, bool]:
    """Return the decimal sign of some numbers, and whether it may be a thousands separator (``1,234``)."""
    # By majority: a few texts that look like numbers must not decide. Numbers without either sign say
    # nothing.
    points = sum(_POINT.fullmatch(cell) is not None for cell in cells)
    commas = [cell for cell in cells if _COMMA.fullmatch(cell)]
    if len(commas) <= points:
        return ".", False
    return ",", not points and all(_THREE.fullmatch(cell) for cell in commas)


def read_number(
    cell: str,
    decimal: str,
    missing: Collection[str] = NO_VALUE,
    *,
    stated: bool = False,
    fractions: bool = False,
) -> float | None:
    """Return the number in a cell, NaN if it is missing, None for anything else.

    A cell with the other decimal sign is not accepted, as guessing might be wrong by a factor of 1000. Only
    if the user has `stated` the decimal sign may the other one separate thousands; and only then is
    ``436 250`` a whole number among numbers with `fractions`, where the blank may stand for a decimal sign.
    """
    if cell in missing:
        return math.nan
    # 1. Thousands separated by the other sign: only if the user has stated the decimal one.
    other = "." if decimal == "," else ","
    if stated and _THOUSANDS[other].fullmatch(cell):
        cell = cell.replace(other, "")
    # 2. Thousands with a decimal sign after them: 1.234,5 can mean one thing only.
    grouped = _GROUPED.fullmatch(cell)
    if grouped and cell.rfind(decimal) > cell.rfind(grouped[1]):
        cell = cell.replace(grouped[1], "")
    # 3. Groups of three with blanks or apostrophes.
    elif _SPACED.fullmatch(cell):
        if fractions and not stated:
            return None
        cell = re.sub(r"['\u00a0\u2009\u202f ]", "", cell)
    # 4. The other decimal sign: refused.
    elif other in cell:
        return None
    plain = cell.replace(decimal, ".")
    if not _NUMBER.fullmatch(plain):
        return None
    value = float(plain)
    return value if math.isfinite(value) else None


def looks_numeric(cell: str) -> bool:
    """Return whether a cell has a number, with any decimal sign, or marks a missing value."""
    return any(read_number(cell, decimal) is not None for decimal in ".,")
