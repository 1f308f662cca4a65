"""Small tables in CSV files, whose heading names each column with its unit: ``time [s],position [mm]``."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigctl.errors import Location, RigctlError
from rigctl.files.regular import read_text
from rigctl.units import Unit, parse_unit

#: largest number of rows of a file
_MOST: Final = 200_000
#: largest size of a file, bytes
_LARGEST: Final = 50_000_000


def heading_parts(cell: str) -> tuple[str, str]:
    """``position [mm]`` as name and unit; "" if there is none."""
    name, _, rest = cell.partition("[")
    return name.strip(), rest.rpartition("]")[0].strip()


@dataclass(frozen=True)
class UnitTable:
    """The cells of a file, and what its heading should be: ``reference [bar],raw``."""

    path: Path
    heading: str
    head: Sequence[str]
    body: Sequence[Sequence[str]]

    @staticmethod
    def read(path: Path, heading: str) -> UnitTable:
        """Read a file.

        Raises
        ------
        RigctlError
            it cannot be read, or is too long.
        """
        where = Location(path)
        try:
            if (size := path.stat().st_size) > _LARGEST:
                raise _too_long(f"{size / 1e6:.0f} MB", f"at most {_LARGEST / 1e6:.0f} MB", where)
            head, *body = list(csv.reader(io.StringIO(read_text(path, "utf-8-sig")))) or [[]]
        except FileNotFoundError as problem:
            raise RigctlError("there is no such file", value=path.as_posix(), where=where) from problem
        except (OSError, UnicodeDecodeError, csv.Error) as problem:
            raise RigctlError(f"cannot read the table: {problem}", where=where) from problem
        if len(body) > _MOST:
            raise _too_long(f"{len(body)} rows", str(_MOST), where)
        return UnitTable(path, heading, head, body)

    def index(self, name: str) -> int:
        """Return the index of a column, or raise a `RigctlError`."""
        names = [heading_parts(cell)[0] for cell in self.head]
        if names.count(name) != 1:
            names = [each.casefold() for each in names]
        if names.count(name) == 1:
            return names.index(name)
        # a file without any of the columns may be any file, whose first line must not appear in a message
        ours = any(heading_parts(cell)[0] in names for cell in self.heading.split(","))
        raise RigctlError(
            f"one column '{name}' is expected",
            value=", ".join(self.head) if ours else f"{names.count(name)} of {len(names)} columns",
            expected=f"'{self.heading}'",
            where=Location(self.path, 1),
        )

    def column(self, name: str, unit: str, *, unstated: str = "1") -> tuple[int, Unit]:
        """Return the index of a column and its unit, which is `unstated` if the heading has none.

        Raises
        ------
        RigctlError
            there is not one such column, or its unit has another dimension than `unit`.
        """
        index = self.index(name)
        written = heading_parts(self.head[index])[1]
        found = parse_unit(written or unstated)
        if found.dimension != parse_unit(unit).dimension:
            raise RigctlError(
                "wrong dimension" if written else "the unit is missing",
                value=self.head[index],
                expected=f"{name} [{unit}]",
                where=Location(self.path, 1),
            )
        return index, found

    def rows(self) -> Iterator[tuple[Location, Sequence[str]]]:
        """The rows that are not empty, each with its place."""
        for line, row in enumerate(self.body, start=2):
            if any(cell.strip() for cell in row):
                yield Location(self.path, line), row


def number(row: Sequence[str], column: int, where: Location) -> float:
    """Return a cell's number, or raise a `RigctlError`."""
    cell = row[column].strip() if column < len(row) else ""
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RigctlError("no number", value=cell, where=where)
    return value


def _too_long(value: str, expected: str, where: Location) -> RigctlError:
    return RigctlError("the table is too long", value=value, expected=expected, where=where)
