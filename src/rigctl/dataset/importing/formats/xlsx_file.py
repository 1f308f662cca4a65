"""Spreadsheets (XLSX): a table on each sheet, with the last row of names above the values as its heading.

A cell that is merged with the one below it names its column too. Formulas are never evaluated: the values
stored by the program that saved the file are read. Dates are cells with a date format.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.importing.cells.headings import is_unit, split_heading, unit_of
from rigctl.dataset.importing.cells.local_time import LocalTime
from rigctl.dataset.importing.cells.missing_values import NO_VALUE
from rigctl.dataset.importing.cells.numbers import (
    Thousands,
    ambiguous_sign,
    comma_remark,
    find_decimal,
    read_number,
)
from rigctl.dataset.importing.cells.time_column import with_time_column
from rigctl.dataset.importing.formats.groups import (
    Column,
    Group,
    GroupedFile,
    clear_errors,
    missing_extra,
    open_groups,
)
from rigctl.dataset.importing.formats.layouts import LayoutRow, repeats_units
from rigctl.dataset.importing.formats.table import require_few_columns
from rigctl.dataset.importing.formats.xlsx_times import read_times
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError
from rigctl.files.regular import regular

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: rows searched for the heading
_HEAD: Final = 100


@dataclass(frozen=True)
class _Sheet:
    """A table on a sheet: names and units by column, and the cells below them."""

    name: str
    names: dict[int, tuple[str, str | None]]
    first: int  #: row of the first cells, from 1
    rows: list[Sequence[Any]]

    def column(self, index: int) -> list[Any]:
        """Return the cells of a column; None where a row is too short."""
        return [row[index] if index < len(row) else None for row in self.rows]


def open_xlsx(path: Path, options: Options) -> GroupedFile:
    """Read a spreadsheet.

    Raises
    ------
    RigctlError
        openpyxl is not installed, the file cannot be read or has no table, or a cell is not a number.
    """
    try:
        from openpyxl import load_workbook
    except ImportError as problem:
        raise missing_extra("xlsx", "openpyxl", path) from problem

    with clear_errors(path, "XLSX"), open(path, "rb", opener=regular) as raw:
        book = load_workbook(raw, read_only=True, data_only=True, keep_links=False)
        sheets = [_read(path, sheet, options.heading) for sheet in book.worksheets]
    tables = [sheet for sheet in sheets if sheet is not None]
    if not tables:
        raise RigctlError(
            "there is no table in it",
            expected="a row of names with units, such as 'time [s]', and numbers below",
            where=Location(path),
        )
    for sheet in tables:
        require_few_columns(path, len(sheet.names), sheet.first)
    remarks = [remark for sheet in tables for remark in _unnamed(sheet)]
    groups = [_group(path, sheet, options, remarks, alone=len(tables) == 1) for sheet in tables]
    file = open_groups(path, lambda: nullcontext(groups), options, noun="sheet")
    return replace(file, remarks=(*file.remarks, *remarks))


def _read(path: Path, sheet: Any, stated: int | None) -> _Sheet | None:
    """Return the table of a sheet; None for a sheet without one.

    Parameters
    ----------
    stated: by the user, the row of the heading; 0 if there is none.

    Raises
    ------
    RigctlError
        there are two rows of units, which differ.
    """
    if hasattr(sheet, "reset_dimensions"):
        sheet.reset_dimensions()  # the size stored in the file may be wrong
    rows = enumerate(sheet.iter_rows(values_only=True), start=1)
    if stated is not None:
        return _below_stated(sheet.title, rows, stated)
    try:
        return _below_names(sheet.title, rows)
    except RigctlError as error:
        error.what = f"in sheet '{sheet.title}': {error.what}"
        error.at(Location(path))
        raise


def _below_names(title: str, rows: Iterator[tuple[int, Sequence[Any]]]) -> _Sheet | None:
    """Return the table below the last row of names, which one or more rows of the same units may follow."""
    heading: tuple[int, Sequence[Any]] | None = None
    units: Sequence[Any] = ()
    above: dict[int, Any] = {}
    for number, cells in rows:
        filled = [cell for cell in cells if not _blank(cell)]
        if filled and all(isinstance(cell, str) for cell in filled):
            adjoins = heading is not None and number == heading[0] + 1 + bool(units)
            higher = {**above, **_named(heading[1])} if heading is not None and adjoins else {}
            if heading is None or not adjoins or not _are_units(filled):
                above = {} if units else _named(higher, without=cells)
                heading, units = (number, cells), ()
            elif units and repeats_units(_row(number - 1, units), _row(number, cells)):
                heading = (number - 1, heading[1])  # and there may be a third
            elif units:  # they are names, which look like units: t, T, V
                above, heading, units = _named(higher, without=units), (number - 1, units), cells
            else:
                units = cells
        elif filled and heading is not None:
            below = _below([cells, *(cells for _, cells in rows)])
            merged = {index: cell for index, cell in above.items() if _filled(below, index)}
            names = _names({**merged, **_named(heading[1])}, units)
            return _Sheet(title, names, number, below)
        if number > _HEAD:
            return None
    return None


def _below_stated(title: str, rows: Iterator[tuple[int, Sequence[Any]]], stated: int) -> _Sheet | None:
    """Return the table below the stated heading; columns without a name have their number."""
    heading = next((cells for number, cells in rows if number == stated), ()) if stated else ()
    units: Sequence[Any] = ()
    for number, cells in rows:
        filled = [cell for cell in cells if not _blank(cell)]
        if not filled:
            continue
        texts = [cell for cell in filled if isinstance(cell, str)]
        if not units and len(texts) == len(filled) and stated == number - 1 > 0 and _are_units(texts):
            units = cells
            continue
        below = _below([cells, *(cells for _, cells in rows)])
        numbers = {at: str(at + 1) for at in range(max(map(len, below))) if _filled(below, at)}
        return _Sheet(title, _names({**numbers, **_named(heading)}, units), number, below)
    return None


def _named(cells: Sequence[Any] | Mapping[int, Any], without: Sequence[Any] = ()) -> dict[int, Any]:
    """Return the cells with a content by column, except for columns with one in `without`."""
    items = cells.items() if isinstance(cells, Mapping) else enumerate(cells)
    other = {index for index, cell in enumerate(without) if not _blank(cell)}
    return {index: cell for index, cell in items if not _blank(cell) and index not in other}


def _filled(rows: Sequence[Sequence[Any]], index: int) -> bool:
    return any(index < len(row) and not _blank(row[index]) for row in rows)


def _unnamed(sheet: _Sheet) -> Iterator[str]:
    """Yield a remark on each column that has values but no name."""
    from openpyxl.utils import get_column_letter

    for index in range(max(map(len, sheet.rows), default=0)):
        if index not in sheet.names and _filled(sheet.rows, index):
            letter = get_column_letter(index + 1)
            yield f"column {letter} of sheet '{sheet.name}' has no name above its values and is left out"


def _blank(cell: Any) -> bool:
    return cell is None or (isinstance(cell, str) and not cell.strip())


def _row(number: int, cells: Sequence[Any]) -> LayoutRow:
    return LayoutRow(number, number, tuple("" if _blank(cell) else str(cell) for cell in cells))


def _are_units(cells: Sequence[str]) -> bool:
    return all(is_unit(cell.strip().strip("[]()")) for cell in cells)


def _names(heading: Mapping[int, Any], units: Sequence[Any]) -> dict[int, tuple[str, str | None]]:
    names = {}
    for index, cell in sorted(heading.items()):
        name, unit = split_heading(str(cell))
        below = units[index] if index < len(units) and not _blank(units[index]) else None
        names[index] = (
            name or str(cell).strip(),
            unit or unit_of(str(below).strip("[]() ") if below else None),
        )
    return names


def _below(rows: list[Sequence[Any]]) -> list[Sequence[Any]]:
    """Return the rows of a table, without trailing blank ones."""
    while rows and all(_blank(cell) for cell in rows[-1]):
        rows.pop()
    return rows


def _group(path: Path, sheet: _Sheet, options: Options, remarks: list[str], *, alone: bool) -> Group:
    import numpy as np

    columns: dict[int, Column] = {}
    options = with_time_column(sheet.names.values(), options)
    ours = {index: options.ours(name) for index, (name, _) in sheet.names.items()}
    numbers = _NumberTexts.of(sheet, [index for index in ours if ours[index] != "-"], options)
    day = next((index for index, name in ours.items() if name == "date"), None)
    unread = _reader(np.full(len(sheet.rows), "", dtype=object))
    for index in sorted(sheet.names, key=lambda index: ours[index] != "time"):  # which decides on the date
        name, unit = sheet.names[index]
        cells = sheet.column(index)
        if ours[index] == "-":  # with any content
            columns[index] = Column(name, unit, unread)
            continue
        if ours[index] == "time":
            where = Location(path, sheet.first, index + 1)
            dates = None if day is None else sheet.column(day)
            written = read_times(path, cells, dates, options.unit_of(name) or unit, options, where)
            if written is not None:
                columns[index] = Column(name, "s", _reader(written.values), seconds=True)
                if day is not None and written.dated:
                    columns[day] = Column(*sheet.names[day], unread, spent=True)
                continue
        if index not in columns:
            own = None if ours[index] == "record" else numbers
            values, own_unit = _values(path, sheet, index, name, cells, options, own)
            columns[index] = Column(name, own_unit or unit, _reader(values))
    numbers.refuse_ambiguous(path, sheet)
    remarks += numbers.doubt()
    ordered = tuple(columns[index] for index in sheet.names)
    return Group("" if alone else sheet.name, len(sheet.rows), ordered, sheet.first)


@dataclass
class _NumberTexts:
    """The numbers on a sheet that are stored as texts, read as in a text file.

    Parameters
    ----------
    decimal: their decimal sign; `stated` if the user has said so.
    """

    decimal: str
    marks: frozenset[str]
    stated: bool
    doubtful: str = ""  #: a text such as ``1,234``, if there are only such ones
    seen: list[int] = field(default_factory=list)  #: indices of the columns with such a text

    @classmethod
    def of(cls, sheet: _Sheet, used: Sequence[int], options: Options) -> _NumberTexts:
        texts = [cell.strip() for at in used for cell in sheet.column(at) if isinstance(cell, str)]
        marks = frozenset((*NO_VALUE, *options.missing))
        if options.decimal is not None:
            return cls(options.decimal, marks, stated=True)
        decimal, doubtful = find_decimal(texts)
        shown = next((text for text in texts if "," in text), "") if doubtful else ""
        return cls(decimal, marks, stated=False, doubtful=shown)

    def read(self, cell: str, *, fractions: bool = False) -> float | None:
        """Return the number in a text; see `read_number`."""
        return read_number(cell.strip(), self.decimal, self.marks, stated=self.stated, fractions=fractions)

    def have_fractions(self, index: int, cells: Sequence[Any]) -> bool:
        """Note that the texts of a column are read; return whether one of them has a decimal sign."""
        self.seen.append(index)
        return any(isinstance(cell, str) and self.decimal in cell and self.read(cell) for cell in cells)

    def doubt(self) -> list[str]:
        """Return the remark on numbers that might be read otherwise."""
        return [comma_remark(self.doubtful)] if self.doubtful and self.seen else []

    def refuse_ambiguous(self, path: Path, sheet: _Sheet) -> None:
        """Refuse ``1.011`` beside 978, where no text of the sheet shows what the point means."""
        check = Thousands(self.decimal)
        for index in self.seen:
            for number, cell in enumerate(sheet.column(index), start=sheet.first):
                whole = isinstance(cell, int | float) and abs(cell) < 1000  # with no separator in a text
                text = str(int(cell)) if whole else cell.strip() if isinstance(cell, str) else ""
                check.take({index: [text]}, [number])
        found = None if self.stated else check.ambiguous()
        if found is not None:
            index, row, cell, whole_number = found
            where = Location(path, row, index + 1)
            raise ambiguous_sign(sheet.names[index][0], cell, whole_number, self.decimal, where)


def _reader(values: NDArray[Any]) -> Callable[[int, int], NDArray[Any]]:
    return lambda start, stop: values[start:stop]


def _values(
    path: Path,
    sheet: _Sheet,
    index: int,
    name: str,
    cells: Sequence[Any],
    options: Options,
    number_texts: _NumberTexts | None,
) -> tuple[NDArray[Any], str | None]:
    """Return a column as numbers, time stamps or texts, with its unit if the cells give it.

    Parameters
    ----------
    number_texts: reads numbers stored as texts; None if texts are names.

    Raises
    ------
    RigctlError
        a cell in a numeric column is not a number.
    """
    import numpy as np

    marks = {*NO_VALUE, *options.missing}
    present = [
        cell for cell in cells if not _blank(cell) and not (isinstance(cell, str) and cell.strip() in marks)
    ]
    if present and all(isinstance(cell, date) for cell in present):
        stamps = np.array([_stamp(cell) for cell in cells], dtype="datetime64[ns]")
        return LocalTime(options.zone).to_utc(stamps), "s"
    texts = [cell for cell in present if isinstance(cell, str)]
    names = [cell for cell in texts if number_texts is None or number_texts.read(cell) is None]
    if 2 * len(names) > len(present):
        return np.array(["" if cell is None else str(cell) for cell in cells], dtype=object), None
    spans = any(isinstance(cell, time | timedelta) for cell in present)
    read = number_texts or _NumberTexts.of(sheet, [index], options)
    numbers = list(_numbers(path, sheet, index, name, cells, read))
    return np.array(numbers, dtype=np.float64), "s" if spans else None


def _stamp(cell: Any) -> Any:
    """Return a date as a NumPy value, without a zone, as spreadsheets have none."""
    if isinstance(cell, datetime):
        return cell.replace(tzinfo=None)
    return datetime(cell.year, cell.month, cell.day) if isinstance(cell, date) else None  # noqa: DTZ001


def _numbers(
    path: Path, sheet: _Sheet, index: int, name: str, cells: Sequence[Any], texts: _NumberTexts
) -> Iterator[float]:
    fractions = texts.have_fractions(index, cells)
    for number, cell in enumerate(cells):
        value: float | None = float("nan")
        if isinstance(cell, timedelta):
            value = cell.total_seconds()
        elif isinstance(cell, time):
            value = cell.hour * 3600.0 + cell.minute * 60.0 + cell.second + cell.microsecond / 1e6
        elif isinstance(cell, str):
            value = texts.read(cell, fractions=fractions)
        elif isinstance(cell, int | float):
            value = float(cell)
        elif cell is not None:
            value = None
        if value is None:
            raise RigctlError(
                f"in sheet '{sheet.name}': {name}: not a number",
                value=str(cell),
                expected=f"a number, '{texts.decimal}' being its decimal sign if it is stored as a text",
                hint=f"--missing '{cell}' takes it as missing; --columns '{name}=-' leaves the column out",
                where=Location(path, sheet.first + number, index + 1),
            )
        yield value
