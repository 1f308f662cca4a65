"""Where the table begins in a text file: the heading, the units, and the first row of values.

What programs write above a table differs: LabVIEW two headers that end in ``***End_of_Header***``, Campbell
loggers four lines (TOA5), instruments a list of their settings. Two of them are known by their first cells;
in all others the heading is the last row of names above the first row of values.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from rigctl.dataset.importing.cells.headings import is_first_axis, is_unit, time_unit, unit_of
from rigctl.dataset.importing.cells.missing_values import NO_VALUE
from rigctl.dataset.importing.cells.numbers import looks_numeric
from rigctl.errors import Location, RigctlError
from rigctl.units import Unit, parse_unit

#: a date or a time of day, in any form, perhaps after the day of the week
_MOMENT: Final = re.compile(r"([A-Za-z]{2,9}[ ,.]+)?[+-]?\d+([:/.-]\d|[- ./]?[A-Za-z]{3,9}[- ./]).*")
_UNIT_ROW: Final = re.compile(r"[\[(]?\s*(?P<unit>[^\[\]()]*?)\s*[\])]?")
_END_OF_HEADER: Final = "***End_of_Header***"
#: rows of values that must follow a row of names, so that it is a heading and not a setting
_VALUES: Final = 2


@dataclass(frozen=True)
class LayoutRow:
    """Cells of one row of the file; `line` and `last` are its first and its last line."""

    line: int
    last: int
    cells: tuple[str, ...]

    @property
    def filled(self) -> list[str]:
        """The cells with a content."""
        return [cell.strip() for cell in self.cells if cell.strip()]


@dataclass(frozen=True)
class Layout:
    """The heading of a table.

    Parameters
    ----------
    cells: of the heading.
    line: of the heading; 0 if the file has none.
    first: index of the first row of values.
    units: of the columns, if they are in a row of their own; empty otherwise.
    unused: indices of columns that count the rows.
    """

    cells: Sequence[str]
    line: int
    first: int
    units: Sequence[str | None] = ()
    unused: frozenset[int] = field(default=frozenset())


def find_layout(rows: Sequence[LayoutRow], index: int) -> Layout | None:
    """Return the heading of a table; None if no row of names stands above its values.

    Parameters
    ----------
    index: of the first row that is as wide as the table.
    """
    if rows[0].cells[0].strip() == "TOA5" and len(rows) > 2:
        return _campbell(rows)
    if rows[0].cells[0].strip() == "LabVIEW Measurement" and (found := _labview(rows)) is not None:
        return found
    return _above_values(rows, index)


def _campbell(rows: Sequence[LayoutRow]) -> Layout:
    """TOA5: the station, the names, their units, and how each was processed, a line each."""
    names, units = rows[1], rows[2].cells
    first = 4 if len(rows) > 3 and not is_data(rows[3]) else 3
    known = [unit_of(unit.strip()) if is_unit(unit) and unit not in ("TS", "RN") else None for unit in units]
    known += [None] * (len(names.cells) - len(known))
    unused = frozenset(index for index, unit in enumerate(units) if unit.strip() == "RN")
    return Layout(names.cells, names.line, first, known, unused)


def _labview(rows: Sequence[LayoutRow]) -> Layout | None:
    """LabVIEW's measurement file: the heading follows the header of the first segment."""
    ends = (at for at, row in enumerate(rows[:-2]) if row.cells[0].strip() == _END_OF_HEADER)
    end = next((at for at in ends if is_data(rows[at + 2])), None)
    if end is None:
        return None
    heading, width = rows[end + 1], max(len(row.cells) for row in rows[end + 2 :])
    cells = list(heading.cells)
    while len(cells) > width and cells[-1].strip() in ("Comment", ""):
        cells.pop()  # the cells of remarks are written only where there is one
    labels = next((row.cells for row in rows[:end] if row.cells[0].strip() == "Y_Unit_Label"), ())
    units: list[str | None] = [None] * len(cells)
    for at, label in enumerate(labels[1 : len(cells)], start=1):
        units[at] = unit_of(label) if is_unit(label) else None
    if cells[0].strip() == "X_Value":
        cells[0], units[0] = "time", "s"
    return Layout(cells, heading.line, end + 2, units)


def _above_values(rows: Sequence[LayoutRow], index: int) -> Layout | None:
    """The last row of names above the first rows of values; a name that it lacks is in the row above."""
    # The values are found first: above them there may be any number of notes and settings, some of which look
    # like names.
    first = next((at for at in range(index, len(rows)) if _begins_values(rows, at)), None)
    if first is None:
        return None
    names = [at for at in range(index, first) if is_names(rows[at])]
    # The names must stand directly above the values; otherwise it is decided by the width of the rows.
    if not names or names[-1] != first - 1:
        return None
    if first - 2 >= index and first - 2 not in names and _names_above_units(rows[first - 2], rows[first - 1]):
        names[-1:] = [first - 2, first - 1]
    units: Sequence[str | None] = ()
    at = names[-1]
    # The row above the values may be the units, and the names one row higher.
    if at - 1 in names and (found := unit_row(rows[at - 1].cells, rows[at])):
        units, at = found, at - 1
        while at - 1 in names and repeats_units(rows[at], rows[at + 1]):
            at -= 1
    width = len(rows[first].cells)
    if len(rows[at].cells) < width:  # a last column without a name
        return None
    cells = list(rows[at].cells)
    above = at - 1
    if above in names and len(rows[above].cells) == len(cells) and not all(cell.strip() for cell in cells):
        merged = zip(cells, rows[above].cells, strict=True)
        cells = [lower if lower.strip() else upper for lower, upper in merged]
    unused = frozenset(number for number, cell in enumerate(cells) if cell.strip() == "#")
    return Layout(cells, rows[at].line, first, units, unused)


def _names_above_units(row: LayoutRow, below: LayoutRow) -> bool:
    """Return whether some names are numbers, as those of an oscilloscope's channels: ``x-axis,1,2``.

    The first column is the time, in a unit of time: ``Interval,0.1,s`` above ``t,V,A`` is a setting, and the
    row below it has the names.
    """
    first, *others = row.filled
    if not len(row.filled) == len(row.cells) == len(below.filled) or not others:
        return False
    is_time = time_unit(first, None)[0] or is_first_axis(row.filled, None)
    named = all(cell.isdigit() or not (is_unit(cell) or looks_numeric(cell)) for cell in others)
    units = [_unit(cell) for cell in below.filled]
    seconds = units[0] is not None and units[0].dimension == parse_unit("s").dimension
    return is_time and named and seconds and None not in units


def repeats_units(upper: LayoutRow, lower: LayoutRow) -> bool:
    """Return whether both rows have units of the same quantities, so that neither has the names.

    Raises
    ------
    RigctlError
        their units differ.
    """
    if len(upper.filled) < 2 or [bool(cell.strip()) for cell in upper.cells] != [
        bool(cell.strip()) for cell in lower.cells
    ]:
        return False
    pairs = [(_unit(one), _unit(other)) for one, other in zip(upper.filled, lower.filled, strict=True)]
    if any(one is None or other is None or one.dimension != other.dimension for one, other in pairs):
        return False
    if any(one != other for one, other in pairs):
        raise _two_rows_of_units(lower.line, upper.filled, lower.filled)
    return True


def _two_rows_of_units(line: int, upper: Sequence[str], lower: Sequence[str]) -> RigctlError:
    """Make the error for two rows of units that differ, below the names of a table."""
    return RigctlError(
        "two rows of units below the names",
        value=", ".join(lower),
        expected=f"those of the row above, {', '.join(upper)}, or one row",
        hint="Delete one of the two rows in a copy of the file",
        where=Location(None, line),
    )


def _unit(cell: str) -> Unit | None:
    match = _UNIT_ROW.fullmatch(cell)
    text = unit_of(match["unit"]) if match and is_unit(match["unit"]) else None
    return parse_unit(text) if text else None


def _begins_values(rows: Sequence[LayoutRow], at: int) -> bool:
    """Return whether at least half of the cells of this row and of the next are values, or all of this one,
    which follows a row of names: a logger may have stopped after a single row.
    """
    if at and is_data(rows[at]) and is_names(rows[at - 1]) and len(rows[at - 1].cells) == len(rows[at].cells):
        return True
    following = rows[at : at + _VALUES]
    width = len(rows[at].cells)
    return all(
        len(row.cells) == width and 2 * sum(_is_value(cell) for cell in row.filled) >= len(row.filled) > 0
        for row in following
    )


def has_value(row: LayoutRow) -> bool:
    """Return whether a row has a number or a moment in some cell."""
    return any(_is_value(cell) for cell in row.filled)


def _is_value(cell: str) -> bool:
    return bool(_MOMENT.fullmatch(cell)) or (cell not in NO_VALUE and looks_numeric(cell))


def is_names(row: LayoutRow) -> bool:
    """Return whether a row has names and no values: at least two, and half of its cells."""
    filled = row.filled
    names = [cell for cell in filled if cell not in NO_VALUE]
    return len(names) > 1 and 2 * len(filled) >= len(row.cells) and not has_value(row)


def is_data(row: LayoutRow) -> bool:
    """Return whether a row has numbers, or a time and numbers, and no names."""
    filled = row.filled
    return any(looks_numeric(cell) for cell in filled) and all(
        looks_numeric(cell) or _MOMENT.fullmatch(cell) for cell in filled
    )


def unit_row(names: Sequence[str], below: LayoutRow) -> list[str | None]:
    """Return the units in a row below the names; empty if it is no row of units.

    A cell that is no unit says something else of its column (``NO.``, ``A123``); most must be units.
    """
    if len(below.cells) != len(names) or any("[" in cell for cell in names) or is_data(below):
        return []
    matches = [_UNIT_ROW.fullmatch(cell.strip()) for cell in below.cells]
    units = [match["unit"] if match else "?" for match in matches]
    filled = [unit for unit in units if unit]
    good = [unit for unit in filled if is_unit(unit) or ":" in unit]
    if not good or (len(good) < len(filled) and 3 * len(good) < len(filled)) or has_value(below):
        return []
    if len(good) < len(filled) and sum(is_unit(name.strip()) for name in names) >= len(good):
        return []
    return [unit_of(unit) if unit in good else None for unit in units]
