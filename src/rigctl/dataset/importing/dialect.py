"""Detects the form of a table in a text file: delimiter, heading and decimal sign."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigctl.dataset.importing.headings import is_unit, split_heading, unit_of
from rigctl.dataset.importing.numbers import find_decimal, looks_numeric
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.table import Heading
from rigctl.errors import Location, RigctlError

#: possible delimiters, the least likely to occur in a cell first
DELIMITERS: Final = ("\t", ";", "|", ",", " ")
#: number of rows used for detection
_ROWS: Final = 400
#: share of the rows that must have the same number of cells if separated by spaces
_MOST_ROWS: Final = 0.75
#: names of delimiters on the command line
_WORDS: Final = {"tab": "\t", "\\t": "\t", "space": " ", "comma": ",", "semicolon": ";", "pipe": "|"}
_MOMENT: Final = re.compile(r".*\d[:/.-]\d.*")
_BARE_RETURN: Final = re.compile(r"\r(?!\n)")
_UNIT_ROW: Final = re.compile(r"[\[(]?\s*(?P<unit>[^\[\]()]*?)\s*[\])]?")


@dataclass(frozen=True)
class Row:
    """Cells of one row of the file; `line` and `last` are its first and its last line."""

    line: int
    last: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Dialect:
    """The delimiter, heading and number format of a file.

    Parameters
    ----------
    headings: of the columns.
    lines: up to and with the heading.
    sample: the first rows after it.
    """

    delimiter: str
    decimal: str
    headings: tuple[Heading, ...]
    lines: int
    sample: tuple[Row, ...]
    remarks: tuple[str, ...]

    def location_of(self, path: Path, index: int) -> Location:
        """Return the place of a column's first cell, or of its heading in a file without rows."""
        if not self.sample:
            return self.headings[index].where
        first = self.sample[0]
        written = self.delimiter.join(first.cells)
        return Location(path, first.line, cell_place(written, self.delimiter, index + 1))

    def column(self, index: int) -> list[str]:
        """Return the cells of a column in the first rows."""
        return [row.cells[index].strip() for row in self.sample if len(row.cells) == len(self.headings)]


def find_dialect(path: Path, head: str, options: Options, *, complete: bool) -> Dialect:
    """Detect the form of a table from the first part of its text.

    Parameters
    ----------
    complete: `head` is the whole file; otherwise its last line may be incomplete.

    Raises
    ------
    RigctlError
        there is no heading, or a column has no name.
    """
    text = _BARE_RETURN.sub(" ", head)
    best = _divide(text, options, complete=complete)
    if best is None:
        raise RigctlError(
            "the file has no heading",
            expected="a first line such as 'time [s],position [mm]'",
            where=Location(path),
        )
    delimiter, rows, index = best
    remarks: list[str] = []
    cells, first, line = _heading(text, delimiter, rows, index)
    if line == 0:
        remarks.append(f"the file has no heading; its columns are called 1 to {len(cells)}")
    elif rows[0].line < line and first:
        remarks.append(f"{len(_before(rows, line))} lines before the heading, on line {line}, are left out")
    sample = rows[first:]
    units, sample = _unit_row(cells, sample)
    lines = sample[0].line - 1 if sample else rows[-1].last
    if first and not units:
        lines = rows[first - 1].last
    elif units:
        lines = rows[first].last
    headings = _headings(path, text, delimiter, line, cells, units, sample)
    numbers = [cell.strip() for row in sample for cell in row.cells]
    decimal, doubtful = (options.decimal, False) if options.decimal else find_decimal(numbers)
    if doubtful:
        shown = next((cell for cell in numbers if "," in cell), "1,5")
        remarks.append(f"numbers such as {shown} are read with a decimal comma; --decimal . reads thousands")
    return Dialect(delimiter, decimal, headings, lines, tuple(sample), tuple(remarks))


def checked_delimiter(written: str | None) -> str | None:
    """Return the character for a delimiter's name.

    Raises
    ------
    RigctlError
        it is more than one character.
    """
    if written is None:
        return None
    sign = _WORDS.get(written.casefold(), written)
    if len(sign) != 1 or sign.isalnum() or sign in "\"'\r\n.":
        raise RigctlError(
            "not a delimiter", value=written, expected=f"one sign, or one of {', '.join(_WORDS)}"
        )
    return sign


def split_row(line: str, delimiter: str) -> list[str]:
    """Split a line into cells; consecutive spaces are one delimiter."""
    if delimiter == " ":
        return re.findall(r"[^\s\[\"]+(?:\s*\[[^\]]*\])?|\"[^\"]*\"|\[[^\]]*\]", line)
    return next(csv.reader([line], delimiter=delimiter), [])


def _rows(text: str, delimiter: str, *, complete: bool) -> list[Row]:
    """Yield the rows that are neither blank nor a comment."""
    if delimiter == " ":
        lines = text.splitlines()[: _ROWS + 1]
        rows = [
            Row(number, number, tuple(cell.strip('"') for cell in split_row(line, " ")))
            for number, line in enumerate(lines, start=1)
            if line.strip() and not line.startswith("#")
        ]
    else:
        rows = []
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
        try:
            before = 0
            for cells in reader:
                line, before = before + 1, reader.line_num
                if any(cell.strip() for cell in cells) and not cells[0].startswith(("#", "sep=")):
                    rows.append(Row(line, before, tuple(cells)))
                if len(rows) > _ROWS:
                    break
        except csv.Error:
            pass
    cut = not complete and len(rows) > 1 and len(rows) <= _ROWS
    return rows[:-1] if cut else rows


def _divide(text: str, options: Options, *, complete: bool) -> tuple[str, list[Row], int] | None:
    """Return the delimiter that gives most rows equally many cells, the rows, and the first of those."""
    delimiter_option = checked_delimiter(options.delimiter)
    best: tuple[float, str, list[Row], int] | None = None
    for delimiter in (delimiter_option,) if delimiter_option else DELIMITERS:
        rows = _rows(text, delimiter, complete=complete)
        if not rows:
            continue
        counts = Counter(len(row.cells) for row in rows)
        usual = max(counts, key=lambda size: (counts[size] * (size > 1), size))
        share = counts[usual] / len(rows) if usual > 1 or delimiter_option else 0.0
        if delimiter == " " and best is not None and (best[0] > 0.0 or share < _MOST_ROWS):
            break  # spaces are delimiters only if no other one fits and most rows agree
        if best is None or share > best[0] + 0.25:
            first = next((index for index, row in enumerate(rows) if len(row.cells) == usual), 0)
            best = (share, delimiter, rows, first if share else 0)
    if best is None:
        return None
    _, delimiter, rows, first = best
    return ("," if best[0] == 0.0 and not delimiter_option else delimiter), rows, first


def _is_data(row: Row) -> bool:
    """Return whether a row has numbers, or a time and numbers, and no names."""
    filled = [cell.strip() for cell in row.cells if cell.strip()]
    return any(looks_numeric(cell) for cell in filled) and all(
        looks_numeric(cell) or _MOMENT.fullmatch(cell) for cell in filled
    )


def _heading(text: str, delimiter: str, rows: list[Row], index: int) -> tuple[list[str], int, int]:
    """Return the heading's cells, the index of the first row after it, and its line; 0 without a heading."""
    row = rows[index]
    if not _is_data(row):
        cells, index = _below_padding(rows, index)
        return cells, index + 1, rows[index].line
    if index and not _is_data(rows[index - 1]) and abs(len(rows[index - 1].cells) - len(row.cells)) <= 1:
        return list(rows[index - 1].cells), index, rows[index - 1].line
    before = text.splitlines()[: row.line - 1]
    for line in range(len(before), 0, -1):
        written = before[line - 1]
        if written.startswith("#"):
            cells = split_row(written.lstrip("# \t"), delimiter)
            if len(cells) == len(row.cells) and not _is_data(Row(line, line, tuple(cells))):
                return cells, index, line
    return [str(number) for number in range(1, len(row.cells) + 1)], index, 0


def _below_padding(rows: Sequence[Row], index: int) -> tuple[list[str], int]:
    """The cells of the heading and its index, where `index` is the first row as wide as the table.

    A spreadsheet pads the notes above a table to its width, and writes a merged heading in two rows: names
    that are missing in one row are taken from the row below it, or above it.
    """
    cells = list(rows[index].cells)
    for number, below in enumerate(rows[index + 1 :], start=index + 1):
        if all(cell.strip() for cell in cells) or len(below.cells) != len(cells) or _is_data(below):
            break
        if _filled(below.cells) < _filled(cells):
            continue  # another note
        if any(looks_numeric(cell) or _MOMENT.fullmatch(cell) for cell in below.cells if cell.strip()):
            break  # values, some of which are texts
        if _unit_row(cells, [below])[0]:
            break
        pairs = zip(below.cells, cells, strict=True)
        cells, index = [lower if lower.strip() else above for lower, above in pairs], number
    return cells, index


def _filled(cells: Sequence[str]) -> int:
    return sum(bool(cell.strip()) for cell in cells)


def _before(rows: Sequence[Row], line: int) -> list[Row]:
    return [row for row in rows if row.line < line]


def _unit_row(cells: Sequence[str], sample: list[Row]) -> tuple[list[str | None], list[Row]]:
    """Return the units from a separate row below the heading, and the rows after it."""
    if not sample or len(sample[0].cells) != len(cells) or any("[" in cell for cell in cells):
        return [], sample
    matches = [_UNIT_ROW.fullmatch(cell.strip()) for cell in sample[0].cells]
    units = [match["unit"] if match else "?" for match in matches]
    filled = [unit for unit in units if unit]
    if not filled or not all(is_unit(unit) or ":" in unit for unit in filled) or _is_data(sample[0]):
        return [], sample
    return [unit_of(unit) for unit in units], sample[1:]


def _headings(
    path: Path,
    text: str,
    delimiter: str,
    line: int,
    cells: Sequence[str],
    units: Sequence[str | None],
    sample: Sequence[Row],
) -> tuple[Heading, ...]:
    written = text.splitlines()[line - 1] if line else ""
    headings = []
    for number, cell in enumerate(cells, start=1):
        where = Location(path, line or None, cell_place(written, delimiter, number) if line else None)
        name, unit = split_heading(cell)
        if not name:
            if (
                number == len(cells)
                and sample
                and not any("".join(row.cells[number - 1 :]) for row in sample)
            ):
                headings.append(Heading("", None, where))  # rows end with a delimiter
                continue
            raise RigctlError(
                f"column {number} has no name",
                value=cell,
                expected="a name and its unit: name [unit]",
                where=where,
            )
        headings.append(Heading(name, (units[number - 1] if units else None) or unit, where))
    return tuple(headings)


def cell_place(line: str, delimiter: str, number: int) -> int | None:
    """Return the column at which cell `number` of a line begins, both from 1; None with quotes or spaces."""
    if '"' in line or delimiter == " ":
        return None
    return sum(len(cell) + 1 for cell in line.split(delimiter)[: number - 1]) + 1
