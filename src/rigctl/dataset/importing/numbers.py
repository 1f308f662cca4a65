"""Numbers and missing values as they stand in a cell."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from typing import Final

from rigctl.dataset.importing.table import NO_VALUE

_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
#: thousands in groups of three and a decimal sign, which leaves no doubt what the groups are
_GROUPED: Final = re.compile(r"[+-]?\d{1,3}([.,' \u00a0\u2009\u202f])\d{3}(\1\d{3})*[.,]\d+")
#: groups that cannot be a decimal sign
_SPACED: Final = re.compile(r"[+-]?\d{1,3}(['\u00a0\u2009\u202f ]\d{3})+")
_POINT: Final = re.compile(r"[+-]?(\d{1,3}(,\d{3})+|\d*)\.\d+([eE][+-]?\d+)?")
_COMMA: Final = re.compile(r"[+-]?(\d{1,3}(\.\d{3})+|\d*),\d+([eE][+-]?\d+)?")
_THOUSANDS: Final = {
    ",": re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?"),
    ".": re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d*)?"),
}
_THREE: Final = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


def find_decimal(cells: Sequence[str]) -> tuple[str, bool]:
    """The decimal sign of some numbers, and whether they might as well be thousands (``1,234``)."""
    points = sum(_POINT.fullmatch(cell) is not None for cell in cells)
    commas = [cell for cell in cells if _COMMA.fullmatch(cell)]
    if len(commas) <= points:
        return ".", False
    return ",", not points and all(_THREE.fullmatch(cell) for cell in commas)


def read_number(
    cell: str, decimal: str, missing: Collection[str] = NO_VALUE, *, stated: bool = False
) -> float | None:
    """The number in a cell, NaN when it is missing, None when there is something else.

    A cell that uses the other decimal sign is something else: guessing would be wrong by a factor of 1000.
    Only where the user has `stated` the decimal sign, the other one may stand between thousands.
    """
    if cell in missing:
        return math.nan
    other = "." if decimal == "," else ","
    if stated and _THOUSANDS[other].fullmatch(cell):
        cell = cell.replace(other, "")
    grouped = _GROUPED.fullmatch(cell)
    if grouped and cell.count(decimal) == 1 and cell.rfind(decimal) > cell.rfind(grouped[1]):
        cell = cell.replace(grouped[1], "")
    elif _SPACED.fullmatch(cell):
        cell = re.sub(r"['\u00a0\u2009\u202f ]", "", cell)
    elif other in cell:
        return None
    plain = cell.replace(decimal, ".", 1)
    if not _NUMBER.fullmatch(plain):
        return None
    value = float(plain)
    return value if math.isfinite(value) else None


def looks_numeric(cell: str) -> bool:
    """Whether a cell holds a number, whatever its decimal sign, or a mark of a missing one."""
    return cell in NO_VALUE or any(read_number(cell, decimal) is not None for decimal in ".,")
