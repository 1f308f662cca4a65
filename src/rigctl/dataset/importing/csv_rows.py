"""Rows of a CSV file one by one: slower, and able to say what is wrong with each."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigctl.dataset.importing.table import MISSING, Fault, Heading, Part, labels_of_texts
from rigctl.errors import Location, RigctlError

_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Cells:
    """How the cells of a row are divided, and how a number is written in one."""

    delimiter: str
    decimal: str


def read_rows(
    path: Path,
    piece: bytes,
    line: int,
    headings: Sequence[Heading],
    cells: Cells,
    wanted: Collection[int],
    record: int | None,
) -> Part:
    """Read the rows of `piece`, whose first one stands on `line`; what cannot be read becomes a fault.

    Raises
    ------
    RigctlError
        the piece is not UTF-8 text.
    """
    import numpy as np

    rows: list[list[float]] = []
    lines: list[int] = []
    texts: list[str] = []
    faults: list[Fault] = []
    for at, found in _rows(decode(path, piece, line), line, cells.delimiter):
        row = _read_row(at, found, headings, cells, wanted)
        if isinstance(row, Fault):
            faults.append(row)
        else:
            rows.append(row)
            lines.append(at)
            texts.append("" if record is None else found[record].strip())
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(wanted))
    columns = {place: np.ascontiguousarray(table[:, index]) for index, place in enumerate(wanted)}
    labels = None if record is None else labels_of_texts(texts)
    return Part(columns, np.array(lines, dtype=np.int64), labels, tuple(faults))


def cell_place(line: str, delimiter: str, number: int) -> int | None:
    """Where the cell `number` (from 1) of a line begins, from 1; None where quotes hide it."""
    if '"' in line:
        return None
    return sum(len(cell) + 1 for cell in line.split(delimiter)[: number - 1]) + 1


def decode(path: Path, piece: bytes, line: int) -> str:
    """The text of a piece of the file that begins on line `line`.

    Raises
    ------
    RigctlError
        it is not UTF-8.
    """
    try:
        return piece.decode("utf-8")
    except UnicodeDecodeError as problem:
        at = line + piece.count(b"\n", 0, problem.start)
        raise RigctlError(
            "the file is not UTF-8 text",
            expected="UTF-8",
            hint="Save it again with that encoding (a spreadsheet calls it 'CSV UTF-8')",
            where=Location(path, at),
        ) from problem


def _rows(text: str, first: int, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every row that is not blank."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    while True:
        line = first + reader.line_num
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as problem:
            cells = [str(problem)]
        if any(cell.strip() for cell in cells):
            yield line, cells


def _read_row(
    line: int, found: list[str], headings: Sequence[Heading], cells: Cells, wanted: Collection[int]
) -> list[float] | Fault:
    if len(found) != len(headings):
        return Fault(
            line,
            "wrong number of cells",
            value=f"{len(found)} cells",
            expected=f"{len(headings)} as in the heading",
        )
    row = []
    for place in wanted:
        cell = found[place].strip()
        value = _read_number(cell, cells.decimal)
        if value is None:
            column = cell_place(cells.delimiter.join(found), cells.delimiter, place + 1)
            number = "a number of s, ms, min or h" if ":" in cell else "a finite number"
            return Fault(line, f"{headings[place].name}: not a number", cell, number, column)
        row.append(value)
    return row


def _read_number(cell: str, decimal: str) -> float | None:
    """The number in a cell, NaN when it is missing, None when there is something else."""
    if cell in MISSING:
        return math.nan
    if decimal == ",":
        cell = cell.replace(",", ".", 1)
    if not _NUMBER.fullmatch(cell):
        return None
    value = float(cell)
    return value if math.isfinite(value) else None
