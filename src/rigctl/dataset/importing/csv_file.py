"""Comma-separated values with a heading ``name [unit]`` for each column.

Comma, semicolon or tab between the cells; a decimal comma where the cells are divided by something else;
UTF-8. Lines before the heading that begin with ``#`` are comments. An empty cell, ``nan`` and ``NA`` are
missing values.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigctl.dataset.importing.table import Fault, Heading, RawTable
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_MISSING: Final = ("", "nan", "NaN", "NAN", "NA", "N/A", "null", "-")
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_HEADING: Final = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?")
_DECIMAL_COMMA: Final = re.compile(r"\d,\d")


@dataclass(frozen=True)
class _Text:
    """A file's text, how its cells are divided, and where its heading stands."""

    path: Path
    content: str
    first_line: int  #: of the heading, from 1
    body: int  #: place in `content` at which the rows begin
    delimiter: str
    decimal: str


def read_csv(path: Path) -> RawTable:
    """Read a file of comma-separated values.

    Raises
    ------
    RigctlError
        the file cannot be read, is not UTF-8, or has no heading. A row that cannot be read is no error but
        a fault of the table.
    """
    text = _open(path)
    headings = _read_headings(text)
    return _read_fast(text, headings) or _read_slowly(text, headings)


def _open(path: Path) -> _Text:
    try:
        content = path.read_bytes().decode("utf-8-sig")
    except OSError as problem:
        raise RigctlError(f"cannot read the file: {problem.strerror}", where=Location(path)) from problem
    except UnicodeDecodeError as problem:
        line = problem.object.count(b"\n", 0, problem.start) + 1
        raise RigctlError(
            "the file is not UTF-8 text", expected="UTF-8", where=Location(path, line)
        ) from problem
    start, number = _heading_place(content)
    body = _line_end(content, start)
    heading, first_row = content[start:body], content[body : _line_end(content, body)]
    if not heading.strip():
        raise RigctlError(
            "the file has no heading",
            expected="a first line such as 'time [s],position [mm]'",
            where=Location(path),
        )
    delimiter = max(",;\t", key=heading.count)
    decimal = "," if delimiter != "," and _DECIMAL_COMMA.search(first_row) else "."
    return _Text(path, content, number, body, delimiter, decimal)


def _heading_place(content: str) -> tuple[int, int]:
    """Where the first line that is neither blank nor a comment begins, and its number."""
    start, number = 0, 1
    while start < len(content):
        end = _line_end(content, start)
        if content[start:end].strip() and content[start] != "#":
            break
        start, number = end, number + 1
    return start, number


def _line_end(content: str, start: int) -> int:
    """The place behind the end of the line that begins at `start`."""
    end = content.find("\n", start)
    return len(content) if end < 0 else end + 1


def _read_headings(text: _Text) -> tuple[Heading, ...]:
    heading = text.content[: text.body].splitlines()[-1]
    headings = []
    for number, cell in enumerate(next(csv.reader([heading], delimiter=text.delimiter)), start=1):
        where = Location(text.path, text.first_line, _place(heading, text.delimiter, number))
        match = _HEADING.fullmatch(cell.strip())
        if match is None or not match["name"]:
            raise RigctlError(
                f"column {number} has no name",
                value=cell,
                expected="a name and its unit: name [unit]",
                where=where,
            )
        headings.append(
            Heading(match["name"], None if match["unit"] is None else match["unit"].strip(), where)
        )
    return tuple(headings)


def _place(line: str, delimiter: str, number: int) -> int | None:
    """Where the cell `number` (from 1) of a line begins, from 1; None where quotes hide it."""
    if '"' in line:
        return None
    return sum(len(cell) + 1 for cell in line.split(delimiter)[: number - 1]) + 1


def _read_fast(text: _Text, headings: Sequence[Heading]) -> RawTable | None:
    """All rows at once; None when one of them needs a closer look."""
    import numpy as np
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    body = text.content[text.body :]
    if not body.strip():
        return None
    names = [str(number) for number in range(len(headings))]
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(body.encode("utf-8")),
            read_options=arrow_csv.ReadOptions(column_names=names),
            parse_options=arrow_csv.ParseOptions(delimiter=text.delimiter),
            convert_options=arrow_csv.ConvertOptions(
                column_types=dict.fromkeys(names, pa.float64()),
                null_values=list(_MISSING),
                decimal_point=text.decimal,
            ),
        )
    except pa.ArrowInvalid:
        return None
    rows = body.count("\n") + (not body.endswith("\n"))
    columns = tuple(table[name].to_numpy() for name in names)
    if len(table) != rows or any(np.isinf(column).any() for column in columns):
        return None
    first = text.first_line + 1
    return RawTable(text.path, tuple(headings), columns, np.arange(first, first + rows, dtype=np.int64))


def _read_slowly(text: _Text, headings: Sequence[Heading]) -> RawTable:
    """Row by row, naming what is wrong with each."""
    import numpy as np

    good: list[list[float]] = []
    lines: list[int] = []
    faults: list[Fault] = []
    for line, cells in _rows(text):
        row = _read_row(text, line, cells, headings)
        if isinstance(row, Fault):
            faults.append(row)
        else:
            good.append(row)
            lines.append(line)
    table: NDArray[np.float64] = np.array(good, dtype=np.float64).reshape(len(good), len(headings))
    columns = tuple(np.ascontiguousarray(column) for column in table.T)
    return RawTable(text.path, tuple(headings), columns, np.array(lines, dtype=np.int64), tuple(faults))


def _rows(text: _Text) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every row that is not blank."""
    reader = csv.reader(io.StringIO(text.content[text.body :], newline=""), delimiter=text.delimiter)
    while True:
        line = text.first_line + reader.line_num + 1
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as problem:
            cells = [str(problem)]
        if any(cell.strip() for cell in cells):
            yield line, cells


def _read_row(text: _Text, line: int, cells: list[str], headings: Sequence[Heading]) -> list[float] | Fault:
    if len(cells) != len(headings):
        return Fault(
            line,
            "wrong number of cells",
            value=f"{len(cells)} cells",
            expected=f"{len(headings)} as in the heading",
        )
    row = []
    for number, cell in enumerate(cells):
        value = _read_number(cell.strip(), text.decimal)
        if value is None:
            column = _place(text.delimiter.join(cells), text.delimiter, number + 1)
            return Fault(
                line, f"{headings[number].name}: not a number", cell.strip(), "a finite number", column
            )
        row.append(value)
    return row


def _read_number(cell: str, decimal: str) -> float | None:
    """The number in a cell, NaN when it is missing, None when there is something else."""
    if cell in _MISSING:
        return math.nan
    if decimal == ",":
        cell = cell.replace(",", ".", 1)
    if not _NUMBER.fullmatch(cell):
        return None
    value = float(cell)
    return value if math.isfinite(value) else None
