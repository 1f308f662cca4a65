"""Reads the rows of a CSV file one by one: slower, but reports the fault of each.

In: a piece of text, and how to divide and read its cells. Out: a `RowBlock` of the rows that are good,
and a fault for each that is not, with its line. A row that repeats the names above the table is skipped;
one that is another heading ends the import, as what follows it would be read under the wrong names.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from rigctl.dataset.importing.cells.missing_values import NO_VALUE, is_comment
from rigctl.dataset.importing.cells.numbers import read_number
from rigctl.dataset.importing.formats.dialect import cell_place, split_row, stripped
from rigctl.dataset.importing.formats.layouts import LayoutRow, is_names
from rigctl.dataset.importing.formats.table import KEPT_FAULTS, Fault, Heading, RowBlock, labels_of_texts
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    from rigctl.dataset.importing.cells.times import TimeReader

_BARE_RETURN: Final = re.compile(r"\r(?!\n)")
#: cells in one row at most
_MOST_CELLS: Final = 100_000


@dataclass(frozen=True)
class Cells:
    """How to split a row into cells and interpret them.

    Parameters
    ----------
    missing: marks of missing values.
    time: indices of the cells that form the time, joined with a space, unless it is a plain number; the last
        of them is the index of the time column.
    stated: the user has specified the decimal sign.
    fractions: indices of the columns in whose first rows a number has a decimal sign.
    repeats: the rows of names above the values, which are skipped where they come again.
    """

    delimiter: str
    decimal: str
    missing: frozenset[str] = frozenset(NO_VALUE)
    time: tuple[int, ...] = ()
    stated: bool = False
    repeats: frozenset[tuple[str, ...]] = frozenset()
    fractions: frozenset[int] = frozenset()


def read_rows(
    text: str,
    line: int,
    headings: Sequence[Heading],
    cells: Cells,
    wanted: Collection[int],
    record: int | None,
    clock: TimeReader | None,
) -> RowBlock:
    """Read the rows of a text that begins on `line`; rows that cannot be read become faults.

    Raises
    ------
    RigctlError
        a row is the heading of another table: the rows below it are not those of this one.
    """
    import numpy as np

    numbers = [index for index in wanted if clock is None or index not in cells.time]
    rows: list[list[float]] = []
    lines: list[int] = []
    texts: list[str] = []
    times: list[str] = []
    faults: list[Fault] = []
    bad = 0
    for at, row_cells in split_rows(text, line, cells.delimiter):
        row = _read_row(at, row_cells, headings, cells, numbers)
        if isinstance(row, Fault):
            if _is_heading(at, row_cells, headings, cells):
                continue
            bad += 1
            if len(faults) < KEPT_FAULTS:
                faults.append(row)
            continue
        rows.append(row)
        lines.append(at)
        texts.append("" if record is None else row_cells[record].strip())
        times.append(" ".join(row_cells[index].strip() for index in cells.time))
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(numbers))
    columns = {index: np.ascontiguousarray(table[:, k]) for k, index in enumerate(numbers)}
    labels = None if record is None else labels_of_texts(texts)
    part = RowBlock(
        columns, np.array(lines, dtype=np.int64), labels, tuple(faults), more_faults=bad - len(faults)
    )
    return part if clock is None else with_times(part, times, headings, cells, clock)


def with_times(
    part: RowBlock, times: Sequence[str], headings: Sequence[Heading], cells: Cells, clock: TimeReader
) -> RowBlock:
    """Return a part with the times of its rows; rows with an invalid time become faults."""
    import numpy as np
    import pyarrow as pa

    plain = ["" if text in cells.missing else text for text in times]
    seconds, wrong = clock.read(pa.array(plain, pa.string()))
    columns = {**part.columns, cells.time[-1]: seconds}
    if not wrong.any():
        return RowBlock(columns, part.lines, part.labels, part.faults, more_faults=part.more_faults)
    good, indices = ~wrong, np.flatnonzero(wrong).tolist()
    name = headings[cells.time[-1]].name
    faults = [
        Fault(int(part.lines[index]), f"{name}: not a time", times[index], clock.form.expected)
        for index in indices[:KEPT_FAULTS]
    ]
    labels = part.labels and type(part.labels)(part.labels.codes[good], part.labels.texts)
    return RowBlock(
        {index: values[good] for index, values in columns.items()},
        part.lines[good],
        labels,
        tuple(sorted((*part.faults, *faults), key=lambda fault: fault.line)),
        more_faults=part.more_faults + len(indices) - len(faults),
    )


def split_rows(text: str, first: int, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and cells of every row that is not blank."""
    if delimiter == " ":
        for number, written in enumerate(text.splitlines(), start=first):
            if (divided := split_row(written, " ")) and not is_comment(divided):
                yield number, divided
        return
    # a carriage return inside a row does not end it, and remains visible in its cell
    shown = _BARE_RETURN.sub("\N{SYMBOL FOR CARRIAGE RETURN}", text)
    if not shown.endswith("\n"):
        shown += "\n"  # which is in the last cell if its quote is not closed, as in a file that was cut off
    reader = csv.reader(io.StringIO(shown, newline=""), delimiter=delimiter)
    while True:
        # Before the row is read: a quoted cell may span several lines, and the row is named by its first.
        line = first + reader.line_num
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as problem:
            cells = [str(problem)]
        if len(cells) > _MOST_CELLS:
            cells = [f"{len(cells)} cells"]
        if any(cell.strip() for cell in cells) and not is_comment(cells):
            yield line, cells


def _is_heading(line: int, row_cells: list[str], headings: Sequence[Heading], cells: Cells) -> bool:
    """Return whether a row repeats one above the values; refuse another heading."""
    if stripped(row_cells) in cells.repeats:
        return True
    row = LayoutRow(line, line, tuple(row_cells))
    known = {cell.strip() for cell in row_cells} & cells.missing
    if not is_names(row) or known - {""} or 2 * len(row.filled) < len(headings):
        return False
    raise RigctlError(
        "another heading, with other columns than the first: the rows below it belong to another table",
        value=f"{cells.delimiter} ".join(row.filled) if cells.delimiter != " " else " ".join(row.filled),
        expected=", ".join(heading.name for heading in headings if heading.name),
        hint="Divide the file there, one table in each; or, if these are no names, mark them as missing "
        f"values: --missing '{row.filled[0]}'",
        where=Location(None, line),
    )


def _read_row(
    line: int, row_cells: list[str], headings: Sequence[Heading], cells: Cells, wanted: Collection[int]
) -> list[float] | Fault:
    while len(row_cells) > len(headings) and not row_cells[-1].strip():
        row_cells.pop()  # a row that ends with a delimiter
    if len(row_cells) != len(headings):
        return Fault(
            line,
            "wrong number of cells",
            value=f"{len(row_cells)} cells" if len(row_cells) > 1 else row_cells[0],
            expected=f"{len(headings)} as in the heading",
        )
    row = []
    for index in wanted:
        cell = row_cells[index].strip(" \t")
        if "\n" in cell:
            return Fault(line, f"{headings[index].name}: a quote is not closed", cell, "one on each side")
        value = read_number(
            cell, cells.decimal, cells.missing, stated=cells.stated, fractions=index in cells.fractions
        )
        if value is None:
            column = cell_place(cells.delimiter.join(row_cells), cells.delimiter, index + 1)
            return Fault(line, f"{headings[index].name}: not a number", cell, _expected(cell, cells), column)
        row.append(value)
    return row


def _expected(cell: str, cells: Cells) -> str:
    other = "," if cells.decimal == "." else "."
    sign = "comma" if cells.decimal == "," else "point"
    whole = read_number(cell, cells.decimal, cells.missing)
    if whole is not None:
        stated = f"--decimal '{cells.decimal}' ({whole:g})"
        return f"a number with a decimal {sign}, as in the first rows, or {stated}"
    if read_number(cell, other) is not None:
        return f"a number with a decimal {sign}, as in the first rows (--decimal says which)"
    return "a finite number"
