"""Times of a spreadsheet that are texts or times of day, perhaps beside dates: read as in a text file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.importing.cells.missing_values import NO_VALUE
from rigctl.dataset.importing.cells.numbers import read_number
from rigctl.dataset.importing.cells.times import TimeReader, find_format
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: a time of day past midnight is a date up to the first of March 1900, counted from here
_ZERO: Final = datetime(1899, 12, 31)  # noqa: DTZ001 - spreadsheets have no zones
_DATED: Final = datetime(1900, 3, 1)  # noqa: DTZ001


@dataclass(frozen=True)
class WrittenTimes:
    """Times as time stamps, UTC, or as seconds of a clock, shape (n,); `dated` if they include the dates."""

    values: NDArray[Any]
    dated: bool


def read_times(
    path: Path,
    cells: Sequence[Any],
    dates: Sequence[Any] | None,
    unit: str | None,
    options: Options,
    where: Location,
) -> WrittenTimes | None:
    """Return the times of a column; None if its cells are numbers, dates or durations.

    Parameters
    ----------
    path: of the file.
    dates: cells of a column of dates, which belong to times of day.
    unit: of the times, as in the heading.
    where: the first cell.

    Raises
    ------
    RigctlError
        the times are ambiguous, or one is invalid.
    """
    import numpy as np
    import pyarrow as pa

    marks = {*NO_VALUE, *options.missing}
    if not any(isinstance(cell, time) or _is_text(cell, marks) for cell in cells):
        return None
    texts = [_text(cell, marks) for cell in cells]
    dated = dates is not None and any(":" in text for text in texts)
    if dated and dates is not None:
        texts = [f"{_day(day)} {text}" if text else "" for day, text in zip(dates, texts, strict=True)]
    form = find_format([text for text in texts if text], unit, options, path, where)
    if form.kind == "number":
        return None
    reader = TimeReader(form)
    seconds, wrong = reader.read(pa.array(texts, pa.string()))
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise RigctlError(
            "time: not a time",
            value=texts[row],
            expected=form.expected,
            hint=f"--missing '{texts[row]}' takes it as missing",
            where=replace(where, line=(where.line or 0) + row),
        )
    if reader.origin is None:
        return WrittenTimes(seconds, dated)
    known = ~np.isnan(seconds)
    later = np.where(known, np.round(seconds * 1e9), 0.0).astype(np.int64)
    stamps = (reader.origin + later).astype("datetime64[ns]")
    return WrittenTimes(np.where(known, stamps, np.datetime64("NaT", "ns")), dated)


def _is_text(cell: Any, marks: set[str]) -> bool:
    return isinstance(cell, str) and bool(cell.strip()) and read_number(cell.strip(), ".", marks) is None


def _text(cell: Any, marks: set[str]) -> str:
    """Return the content of a cell as it would be in a text file; empty for a missing one."""
    if isinstance(cell, datetime) and cell < _DATED:
        cell = cell - _ZERO
    if isinstance(cell, timedelta):
        micros = cell // timedelta(microseconds=1)
        hours, rest = divmod(micros, 3_600_000_000)
        minutes, rest = divmod(rest, 60_000_000)
        return f"{hours:02d}:{minutes:02d}:{rest // 1_000_000:02d}.{rest % 1_000_000:06d}"
    if isinstance(cell, date | time):
        return cell.isoformat()
    text = "" if cell is None else str(cell).strip()
    return "" if text in marks else text


def _day(cell: Any) -> str:
    if isinstance(cell, datetime):
        return cell.date().isoformat()
    return cell.isoformat() if isinstance(cell, date) else "" if cell is None else str(cell).strip()
