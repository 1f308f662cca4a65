"""Detects the form of a table in a text file: delimiter, heading and decimal sign.

In: the first part of the text, and what the user has stated. Out: a `Dialect`, with which the whole file
is read. The order: the delimiter, since without cells there is no heading; the heading, since without it
nobody knows where the values begin; the units below it; the decimal sign, from the values alone. What the
user has stated is never looked for. What remains doubtful becomes a remark, or a refusal where a wrong
guess would change numbers (docs/decisions/0037-file-ambiguities-are-put-to-the-user.md).
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from rigctl.dataset.importing.cells.headings import split_heading, time_unit
from rigctl.dataset.importing.cells.missing_values import is_comment
from rigctl.dataset.importing.cells.numbers import comma_remark, find_decimal, read_number
from rigctl.dataset.importing.formats.layouts import (
    Layout,
    LayoutRow,
    find_layout,
    has_value,
    is_data,
    is_names,
    unit_row,
)
from rigctl.dataset.importing.formats.table import Heading, require_few_columns
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError

#: possible delimiters, the least likely to occur in a cell first
DELIMITERS: Final = ("\t", ";", "|", ",", " ")
#: number of rows used for detection
SAMPLE_ROWS: Final = 400
#: share of the rows that must have the same number of cells if separated by spaces
_MOST_ROWS: Final = 0.75
#: names of delimiters on the command line
_WORDS: Final = {"tab": "\t", "\\t": "\t", "space": " ", "comma": ",", "semicolon": ";", "pipe": "|"}
_BARE_RETURN: Final = re.compile(r"\r(?!\n)")
_PERCENT: Final = re.compile(r"\s*%(\s|%|$)")


@dataclass(frozen=True)
class Dialect:
    """The delimiter, heading and number format of a file.

    Parameters
    ----------
    headings: of the columns.
    lines: up to and with the heading.
    sample: the first rows after it.
    repeats: the rows of names above the values, which a logger that starts again writes again.
    """

    delimiter: str
    decimal: str
    headings: tuple[Heading, ...]
    lines: int
    sample: tuple[LayoutRow, ...]
    remarks: tuple[str, ...]
    repeats: frozenset[tuple[str, ...]] = frozenset()

    def location_of(self, path: Path, index: int) -> Location:
        """Return the place of a column's first cell, or of its heading in a file without rows."""
        if not self.sample:
            return self.headings[index].where
        first = self.sample[0]
        written = self.delimiter.join(first.cells)
        return Location(path, first.line, cell_place(written, self.delimiter, index + 1))

    @property
    def fractions(self) -> frozenset[int]:
        """The indices of the columns in whose first rows a number has a decimal sign."""
        return frozenset(
            index
            for index in range(len(self.headings))
            if any(
                self.decimal in cell and read_number(cell, self.decimal) is not None
                for cell in self.column(index)
            )
        )

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
    # 1. The delimiter: the one by which most rows have the same number of cells.
    best = _divide(text, options, complete=complete)
    if best is None:
        raise RigctlError(
            "the file has no heading",
            expected="a first line such as 'time [s],position [mm]'",
            where=Location(path),
        )
    delimiter, rows, index = best
    require_few_columns(path, max(len(row.cells) for row in rows), rows[index].line)
    remarks: list[str] = []
    try:
        # 2. The heading: the stated line, or the row of names above the first values.
        layout = _layout(text, delimiter, rows, index, options.heading)
    except RigctlError as problem:
        raise problem.at(Location(path, problem.where.line)) from None
    if layout.line == 0 and options.heading is None:
        remarks.append(f"the file has no heading; its columns are called 1 to {len(layout.cells)}")
    before = [row for row in rows if row.line < layout.line]
    if before and options.heading is None:
        lines_before = "1 line" if len(before) == 1 else f"{len(before)} lines"
        verb = "is" if len(before) == 1 else "are"
        remarks.append(f"{lines_before} before the heading, on line {layout.line}, {verb} left out")
    # 3. Units, if they are in a row of their own.
    units, sample = list(layout.units), rows[layout.first :]
    if not units and layout.line and sample and (units := unit_row(layout.cells, sample[0])):
        sample = sample[1:]
    start = len(rows) - len(sample)
    lines = rows[start - 1].last if start else (sample[0].line - 1 if sample else 0)
    lines = max(lines, layout.line)
    headings = _numbered(_headings(path, text, delimiter, layout, units, sample), options)
    # 4. The decimal sign. The whole file is examined later for what these rows cannot tell, see `open_csv`.
    numbers = [cell.strip() for row in sample for cell in row.cells]
    decimal, doubtful = (options.decimal, False) if options.decimal else find_decimal(numbers)
    if doubtful:
        shown = next((cell for cell in numbers if "," in cell), "1,5")
        remarks.append(comma_remark(shown))
    # A logger that starts again writes its names again, in the middle of the file.
    repeats = frozenset(
        stripped(row.cells) for row in rows[:start] if len(row.filled) > 1 and not is_data(row)
    )
    return Dialect(delimiter, decimal, headings, lines, tuple(sample), tuple(remarks), repeats)


def stripped(cells: Sequence[str]) -> tuple[str, ...]:
    """Return the cells of a row without blanks around them, and without empty ones at its end."""
    plain = [cell.strip() for cell in cells]
    while plain and not plain[-1]:
        plain.pop()
    return tuple(plain)


def _numbered(headings: tuple[Heading, ...], options: Options) -> tuple[Heading, ...]:
    """Return the headings; a column that the user calls by its number has that name."""
    names = {heading.name for heading in headings}
    called = {name for name in options.columns if name.isdigit() and name not in names}
    return tuple(
        replace(heading, name=str(number), spent=False) if str(number) in called else heading
        for number, heading in enumerate(headings, start=1)
    )


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


def _rows(text: str, delimiter: str, *, complete: bool) -> list[LayoutRow]:
    """Yield the rows that are neither blank nor a comment."""
    if delimiter == " ":
        lines = text.splitlines()[: SAMPLE_ROWS + 1]
        rows = [
            LayoutRow(number, number, tuple(cell.strip('"') for cell in split_row(line, " ")))
            for number, line in enumerate(lines, start=1)
            if line.strip() and not is_comment(split_row(line, " "))
        ]
        usual = Counter(len(row.cells) for row in rows).most_common(1)
        # '# time speed' above rows of two cells is a comment with their names
        rows = [row for row in rows if row.cells[:1] != ("#",) or len(row.cells) != usual[0][0] + 1]
    else:
        rows = []
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
        try:
            before = 0
            for cells in reader:
                line, before = before + 1, reader.line_num
                blank = not any(cell.strip() for cell in cells)
                if not blank and not is_comment(cells) and not (line == 1 and cells[0].startswith("sep=")):
                    rows.append(LayoutRow(line, before, tuple(cells)))
                if len(rows) > SAMPLE_ROWS:
                    break
        except csv.Error:
            pass
    rows = _without_percent_comments(rows, delimiter)
    cut = not complete and len(rows) > 1 and len(rows) <= SAMPLE_ROWS
    return rows[:-1] if cut else rows


def _without_percent_comments(rows: list[LayoutRow], delimiter: str) -> list[LayoutRow]:
    """Return the rows without the comments that begin with ``%`` and a space, above everything else.

    Below a row of names, ``%`` is a unit; in a row as wide as the table, the name of a column, unless the
    time or, between spaces, the names follow it.
    """
    first = next((at for at, row in enumerate(rows) if not _PERCENT.match(row.cells[0])), len(rows))
    if not first or first == len(rows):
        return rows
    width = Counter(len(row.cells) for row in rows[first:]).most_common(1)[0][0]
    if delimiter == " ":
        wide = [row for row in rows[:first] if len(row.cells) == width + 1]
        named = [] if wide or not is_data(rows[first]) else rows[first - 1 : first]
    else:
        named = [row for row in rows[:first] if _names_percent(row, width)]
    return [*(row for row in named if len(row.cells) == width), *rows[first:]]


def _names_percent(row: LayoutRow, width: int) -> bool:
    """Return whether the first column of a heading is called ``%`` or ``% open``: another one is the time."""
    name = row.cells[0].strip().lstrip("% ")
    times = [time_unit(*split_heading(cell))[0] for cell in row.cells[1:]]
    return len(row.cells) == width and is_names(row) and (not name or any(times))


def _divide(text: str, options: Options, *, complete: bool) -> tuple[str, list[LayoutRow], int] | None:
    """Return the delimiter that gives most rows equally many cells, the rows, and the first of those."""
    delimiter_option = checked_delimiter(options.delimiter)
    best: tuple[float, str, list[LayoutRow], int] | None = None
    for delimiter in (delimiter_option,) if delimiter_option else DELIMITERS:
        rows = _rows(text, delimiter, complete=complete)
        if not rows:
            continue
        counts = Counter(len(row.cells) for row in rows)
        usual = max(counts, key=lambda size: (counts[size] * (size > 1), size))
        # A delimiter that leaves one cell in each row has divided nothing.
        share = counts[usual] / len(rows) if usual > 1 or delimiter_option else 0.0
        if delimiter == " " and best is not None and (best[0] > 0.0 or share < _MOST_ROWS):
            break  # spaces are delimiters only if no other one fits and most rows agree
        # An earlier one, less likely within a cell, gives way only to one that fits clearly better.
        if best is None or share > best[0] + 0.25:
            first = next((index for index, row in enumerate(rows) if len(row.cells) == usual), 0)
            best = (share, delimiter, rows, first if share else 0)
    if best is None:
        return None
    _, delimiter, rows, first = best
    return ("," if best[0] == 0.0 and not delimiter_option else delimiter), rows, first


def _layout(text: str, delimiter: str, rows: list[LayoutRow], index: int, heading: int | None) -> Layout:
    """Return the heading: the stated one, or the one that is found."""
    if heading == 0:
        return _unnamed(rows, index)  # and a row without values there is a bad one
    if heading is not None:
        return _stated(text, delimiter, rows, heading)
    return find_layout(rows, index) or _as_wide(text, delimiter, rows, index)


def _as_wide(text: str, delimiter: str, rows: list[LayoutRow], index: int) -> Layout:
    """Return the first row as wide as the table as its heading; if it has values, what is above it."""
    row, width = rows[index], len(rows[index].cells)
    if not is_data(row):
        cells, index = _below_padding(rows, index)
        return Layout(cells, rows[index].line, index + 1)
    if index and not is_data(rows[index - 1]) and abs(len(rows[index - 1].cells) - width) <= 1:
        return Layout(rows[index - 1].cells, rows[index - 1].line, index)
    commented = _in_comments(text, delimiter, row.line, width)
    if commented:
        heading, units = commented[-1], list[str | None]()
        if len(commented) > 1 and commented[-2].line == heading.line - 1:
            units = unit_row(commented[-2].cells, heading)
        heading = commented[-2] if units else heading
        return Layout(heading.cells, heading.line, index, units)
    if index and is_names(above := rows[index - 1]):
        raise RigctlError(
            f"the heading has {len(above.cells)} names, and the rows below it have {width} cells",
            value=", ".join(above.filled),
            expected="a name for each cell; a decimal comma in a file with commas divides a number in two",
            hint="Say what separates the cells, --delimiter ';', or that there is no heading, --heading 0",
            where=Location(None, above.line),
        )
    return _unnamed(rows, index)


def _in_comments(text: str, delimiter: str, line: int, width: int) -> list[LayoutRow]:
    """Return the comments above a line that have as many names as the table has columns."""
    written = enumerate(text.splitlines()[: line - 1], start=1)
    comments = ((at, one.lstrip("#% \t")) for at, one in written if one.startswith(("#", "%")))
    rows = [LayoutRow(at, at, tuple(split_row(one, delimiter))) for at, one in comments]
    return [row for row in rows if len(row.cells) == width and not is_data(row)]


def _unnamed(rows: Sequence[LayoutRow], first: int) -> Layout:
    return Layout([str(number) for number in range(1, len(rows[first].cells) + 1)], 0, first)


def _stated(text: str, delimiter: str, rows: Sequence[LayoutRow], heading: int) -> Layout:
    """Return the heading on the line that the user has stated."""
    lines = text.splitlines()
    written = lines[heading - 1] if heading <= len(lines) else ""
    row = next((row for row in rows if row.line <= heading <= row.last), None)
    cells = row.cells if row is not None else tuple(split_row(written.lstrip("#% \t"), delimiter))
    if not any(cell.strip() for cell in cells):
        raise RigctlError(
            f"--heading: there is nothing on line {heading}",
            value=str(heading),
            expected=f"a line with the names of the columns, up to {len(lines)}, or 0 if there are no names",
        )
    first = next((at for at, row in enumerate(rows) if row.line > heading), len(rows))
    return Layout(cells, heading, first)


def _below_padding(rows: Sequence[LayoutRow], index: int) -> tuple[list[str], int]:
    """The cells of the heading and its index, where `index` is the first row as wide as the table.

    A spreadsheet pads the notes above a table to its width, and writes a merged heading in two rows: names
    that are missing in one row are taken from the row below it, or above it.
    """
    cells = list(rows[index].cells)
    for number, below in enumerate(rows[index + 1 :], start=index + 1):
        if all(cell.strip() for cell in cells) or len(below.cells) != len(cells) or is_data(below):
            break
        if len(below.filled) < sum(bool(cell.strip()) for cell in cells):
            continue  # another note
        if has_value(below) or unit_row(cells, below):
            break  # values, some of which are texts, or units
        pairs = zip(below.cells, cells, strict=True)
        cells, index = [lower if lower.strip() else above for lower, above in pairs], number
    return cells, index


def _headings(
    path: Path,
    text: str,
    delimiter: str,
    layout: Layout,
    units: Sequence[str | None],
    sample: Sequence[LayoutRow],
) -> tuple[Heading, ...]:
    """Return a heading for each column; one without a name is called by its number."""
    line, count = layout.line, len(layout.cells)
    written = text.splitlines()[line - 1] if line else ""
    headings = []
    for number, cell in enumerate(layout.cells, start=1):
        where = Location(path, line or None, cell_place(written, delimiter, number) if line else None)
        name, unit = split_heading(cell)
        if not name:
            if cell.strip():
                raise RigctlError(
                    f"column {number} has no name", value=cell, expected="name [unit]", where=where
                )
            if number == count and sample and not any("".join(row.cells[number - 1 :]) for row in sample):
                headings.append(Heading("", None, where))  # rows end with a delimiter
                continue
            name = str(number)
        unit = (units[number - 1] if units else None) or unit
        headings.append(Heading(name, unit, where, spent=number - 1 in layout.unused))
    return tuple(headings)


def cell_place(line: str, delimiter: str, number: int) -> int | None:
    """Return the column at which cell `number` of a line begins, both from 1; None with quotes or spaces."""
    if '"' in line or delimiter == " ":
        return None
    return sum(len(cell) + 1 for cell in line.split(delimiter)[: number - 1]) + 1
