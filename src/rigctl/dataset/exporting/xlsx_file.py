"""A spreadsheet (XLSX): a sheet for each record, ``name [unit]`` in its first row."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.exporting.tables import pieces
from rigctl.dataset.importing.formats.groups import missing_extra
from rigctl.errors import RigctlError

if TYPE_CHECKING:
    import pyarrow as pa

#: characters that are not allowed in a cell
_CONTROL: Final = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f]")
#: rows per sheet, limited by the format
_MOST_ROWS: Final = 1_048_576
#: characters that are not allowed in the name of a sheet, and its maximum length
_FORBIDDEN: Final = re.compile(r"[\[\]:*?/\\]")
_LONGEST: Final = 31


def write(path: Path, table: pa.Table, names: Sequence[str], title: str) -> None:
    """Write the table; a missing value is an empty cell, and no cell is a formula.

    Raises
    ------
    RigctlError
        openpyxl is not installed, or a record has more rows than fit in a sheet.
    """
    try:
        from openpyxl import Workbook
        from openpyxl.cell import WriteOnlyCell
    except ImportError as problem:
        raise missing_extra("xlsx", "openpyxl", path) from problem

    def cell(sheet: Any, value: Any) -> Any:
        if isinstance(value, str):
            made = WriteOnlyCell(sheet, _CONTROL.sub("\N{REPLACEMENT CHARACTER}", value))
            made.data_type = "s"  # a text that begins with '=' must not become a formula
            return made
        return None if isinstance(value, float) and math.isnan(value) else value

    book = Workbook(write_only=True)
    taken: set[str] = set()
    for piece in pieces(table, names, title):
        rows = len(piece.columns[0].values)
        if rows >= _MOST_ROWS:
            raise RigctlError(
                "a sheet cannot hold so many rows",
                value=f"{rows} rows of {piece.name}",
                expected=f"at most {_MOST_ROWS - 1}",
                hint="Write it as .parquet or .csv",
            )
        sheet = book.create_sheet(_sheet_name(piece.name, taken))
        heads = [f"{column.name} [{column.unit}]" if column.unit else column.name for column in piece.columns]
        sheet.append([cell(sheet, head) for head in heads])
        for row in zip(*(column.values.tolist() for column in piece.columns), strict=True):
            sheet.append([cell(sheet, value) for value in row])
    book.save(path)


def _sheet_name(name: str, taken: set[str]) -> str:
    """Return a valid, unique name for a sheet."""
    plain = (_FORBIDDEN.sub("_", name).strip("'") or "sheet")[:_LONGEST]
    candidate, number = plain, 2
    while candidate.casefold() in taken:
        candidate = f"{plain[: _LONGEST - 5]} {number}"
        number += 1
    taken.add(candidate.casefold())
    return candidate
