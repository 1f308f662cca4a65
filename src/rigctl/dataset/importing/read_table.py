"""A file as a table of numbers, without a rig.

For commands that look at a file before there is a bench: drafts of a family, previews, tables that are
judged. The same readers and the same rules as for an import, so that what one command understands all do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.dataset.importing.cells.sentinels import Sentinels, blanked, without_marked_times
from rigctl.dataset.importing.cells.time_column import with_time_column
from rigctl.dataset.importing.checks import marks_of
from rigctl.dataset.importing.formats.formats import open_source
from rigctl.dataset.importing.formats.table import RowBlock, Source, refuse
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class TableColumn:
    """One column of numbers, as in the file.

    Parameters
    ----------
    name: in the file, without its unit.
    unit: in the file; None if it has none. Times that are dates or clocks are in s.
    values: shape (n,), NaN where one is missing.
    """

    name: str
    unit: str | None
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Table:
    """The numeric columns of a file.

    Parameters
    ----------
    columns: in the order of the file.
    time: index of the time among `columns`; None if there is none.
    origin: nanoseconds from 1970-01-01 UTC to time zero; None if the times are not absolute.
    texts: names of the columns without numbers.
    records: record of each row from a column ``record``; None without one.
    remarks: remarks on the file, one sentence each.
    """

    path: Path
    columns: tuple[TableColumn, ...]
    time: int | None
    origin: int | None
    texts: tuple[str, ...]
    records: tuple[str, ...] | None
    remarks: tuple[str, ...]

    def column(self, name: str) -> TableColumn | None:
        """Return the numeric column of that name in the file; None if there is none."""
        return next((column for column in self.columns if column.name == name), None)


def read_table(path: Path, options: Options | None = None, *, keep_good: bool = False) -> Table:
    """Read all numeric columns of a file, with their units and the time.

    Parameters
    ----------
    options: how to read the file where that is ambiguous; ``columns`` may name the time (``{"Uhrzeit":
        "time"}``) and the columns to omit.
    keep_good: skip rows that cannot be read.

    Raises
    ------
    RigctlError
        the file cannot be read, a row is bad, or the file is empty.
    """
    settings = options or Options()
    return table_of(open_source(path, settings), path, settings, keep_good=keep_good)


def table_of(
    source: Source, path: Path, options: Options, *, keep_good: bool = False, most: int | None = None
) -> Table:
    """Return the numeric columns of a file opened with `options`; see `read_table`.

    Parameters
    ----------
    most: number of rows that suffice; the part of the file with the last of them is read completely.
    """
    import numpy as np

    options = with_time_column(((heading.name, heading.unit) for heading in source.headings), options)
    ours = [options.ours(heading.name) for heading in source.headings]
    record = ours.index("record") if "record" in ours else None
    indices = [
        index
        for index, heading in enumerate(source.headings)
        if index != record and heading.name and not heading.spent and ours[index] != "-"
    ]
    wanted = [index for index in indices if has_numbers(source, index, empty=True)]
    parts: list[RowBlock] = []
    for part in source.parts(wanted, record) if wanted else ():
        parts.append(part)
        if most is not None and sum(len(one.lines) for one in parts) >= most:
            break
    dated = [index for index in wanted if ours[index] == "time" and source.headings[index].seconds]
    times = [index for index in wanted if ours[index] == "time" and index not in dated]
    parts = _without_marks(parts, [index for index in wanted if index not in dated], times, options)
    faults = [fault for part in parts for fault in part.faults]
    if faults and not keep_good:
        raise refuse(path, faults, len(faults) + sum(part.more_faults for part in parts), imports=False)
    if not sum(len(part.lines) for part in parts):
        raise RigctlError("there is nothing in it", expected="rows of values", where=Location(path))
    columns = tuple(
        TableColumn(
            source.headings[index].name,
            source.headings[index].unit,
            np.concatenate([part.columns[index] for part in parts]),
        )
        for index in wanted
    )
    labels = [part.labels for part in parts if part.labels is not None]
    return Table(
        path,
        columns,
        next((at for at, index in enumerate(wanted) if ours[index] == "time"), None),
        source.origin,
        tuple(source.headings[index].name for index in indices if index not in wanted),
        tuple(label.texts[code] for label in labels for code in label.codes.tolist()) or None,
        source.remarks,
    )


def _without_marks(
    parts: Sequence[RowBlock], numbers: Sequence[int], times: Sequence[int], options: Options
) -> list[RowBlock]:
    """Return all rows without the numbers that mark missing values, as an import reads them.

    Parameters
    ----------
    numbers, times: indices of the columns of numbers, and of those of them that are times.
    """
    keep = "none" in options.missing
    sentinels = Sentinels([] if keep else numbers, times)
    for part in parts:
        sentinels.take(part)
    found, given = sentinels.found(), marks_of(options.missing_numbers)
    marks = {index: (*given, *found.get(index, ())) for index in numbers if index not in times}
    marked = {index: found[index] for index in times if index in found}
    return [blanked(without_marked_times(part, marked, "time"), marks) for part in parts]


def has_numbers(source: Source, index: int, *, empty: bool = False) -> bool:
    """Return whether there are numbers in the first rows of a column, not texts; `empty` if neither."""
    import numpy as np

    try:
        first = next(iter(source.parts([index], None)), None)
    except RigctlError:
        return False
    if first is None:
        return False
    bad = len(first.faults) + first.more_faults
    return (empty and not bad) or int(np.isfinite(first.columns[index]).sum()) > bad


def stamped_column(path: Path, source: Source, options: Options) -> str | None:
    """Return the first column of dates or times of day, whatever its name; None without one."""
    for index, heading in enumerate(source.headings):
        name = heading.name
        if not name or name in options.columns or has_numbers(source, index, empty=True):
            continue
        timed = replace(options, columns={**options.columns, name: "time"})
        try:
            read = table_of(open_source(path, timed), path, timed, keep_good=True, most=1)
        except RigctlError:
            continue  # other words, or a date that can be read in two ways
        if read.time is not None:
            return name
    return None
