"""The table of a waveform from a CSV file with the columns ``time [s]`` and ``NAME [unit]``."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from rigctl.errors import Location, RigctlError
from rigctl.files.regular import read_text
from rigctl.units import Unit, parse_unit

#: largest number of rows of a file
_MOST: Final = 200_000
#: largest size of a file, bytes
_LARGEST: Final = 50_000_000


def read_table(
    path: Path, name: str, unit: str, check: Callable[[float], None]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the times, s, and the SI values of a file.

    Parameters
    ----------
    name, unit: the actuator whose column is read, and a unit of its dimension.
    check: raises for a value that is invalid for the actuator; the line is added to the message.

    Raises
    ------
    RigctlError
        the file cannot be read, a column or a number is missing, or a value is invalid; with the line.
    """
    text = _text(path)
    try:
        rows = list(csv.reader(io.StringIO(text)))
    except csv.Error as problem:
        raise RigctlError(f"cannot read the table: {problem}", where=Location(path)) from problem
    if len(rows) > _MOST:
        raise RigctlError(
            "the table is too long", value=f"{len(rows)} rows", expected=f"{_MOST}", where=Location(path)
        )
    head = rows[0] if rows else []
    time_column, time_unit = _column(head, "time", "s", path)
    value_column, value_unit = _column(head, name, unit, path)
    times, values = [], []
    for line, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        where = Location(path, line)
        times.append(_number(row, time_column, time_unit, where))
        values.append(_number(row, value_column, value_unit, where))
        try:
            check(values[-1])
        except RigctlError as error:
            raise error.at(where) from None
        if len(times) > 1 and times[-1] <= times[-2]:
            raise RigctlError("the time does not increase", value=row[time_column].strip(), where=where)
    if len(times) < 2:
        raise RigctlError("too few rows", expected="at least two", where=Location(path))
    return tuple(time - times[0] for time in times), tuple(values)


def _text(path: Path) -> str:
    """Return the file's text, of limited size."""
    try:
        if (size := path.stat().st_size) > _LARGEST:
            raise RigctlError(
                "the table is too long",
                value=f"{size / 1e6:.0f} MB",
                expected=f"at most {_LARGEST / 1e6:.0f} MB",
                where=Location(path),
            )
        return read_text(path, "utf-8-sig")
    except (OSError, UnicodeDecodeError) as problem:
        raise RigctlError(f"cannot read the table: {problem}", where=Location(path)) from problem


def _column(head: Sequence[str], name: str, unit: str, path: Path) -> tuple[int, Unit]:
    """Return the index of a column, and its unit."""
    names = [cell.partition("[")[0].strip() for cell in head]
    expected = f"'time [s],{name} [{unit}]'" if name != "time" else "a column 'time [s]'"
    if names.count(name) != 1:
        # a file without a column of times may be any file, whose first line must not appear in a message
        shown = ", ".join(head) if "time" in names else f"{names.count(name)} of {len(head)} columns"
        raise RigctlError(
            f"one column '{name}' is expected",
            value=shown,
            expected=expected,
            where=Location(path, 1),
        )
    index = names.index(name)
    written = head[index].partition("[")[2].rpartition("]")[0].strip()
    found = parse_unit(written or "1")
    if found.dimension != parse_unit(unit).dimension:
        raise RigctlError(
            "wrong dimension" if written else "the unit is missing",
            value=head[index],
            expected=f"{name} [{unit}]",
            where=Location(path, 1),
        )
    return index, found


def _number(row: Sequence[str], column: int, unit: Unit, where: Location) -> float:
    cell = row[column].strip() if column < len(row) else ""
    try:
        value = unit.to_si(float(cell))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RigctlError("no number", value=cell, where=where)
    return value
