"""Files with groups of columns: each group is a record, unless the file says otherwise.

These are the groups of a LabVIEW file, the channel groups of an MDF file, and the structures of a MATLAB
file. Their readers make `Group`s of them; what is common to all is here: which groups are used, whether
they are records or parts of one measurement, one list of headings for all of them, and absolute times.

Values are read when they are asked for, in parts, so that a file may be larger than memory.
"""

from __future__ import annotations

import gc
import logging
import sys
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigctl.dataset.importing.cells.labels import LARGEST
from rigctl.dataset.importing.cells.time_column import with_time_column
from rigctl.dataset.importing.cells.times import ArrayClock, array_clock
from rigctl.dataset.importing.formats.table import (
    PART_ROWS,
    Fault,
    Heading,
    Labels,
    RowBlock,
    labels_of_numbers,
    labels_of_texts,
)
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: a file of more bytes than this is read in pieces, and again on each pass
LARGE: Final = 1 << 28


@dataclass(frozen=True)
class Column:
    """One column of a group: `read` returns the values from one row to another, as in the file.

    `seconds` and `spent` are those of its `Heading`.
    """

    name: str
    unit: str | None
    read: Callable[[int, int], NDArray[Any]]
    seconds: bool = False
    spent: bool = False


@dataclass(frozen=True)
class Group:
    """Columns of equal length. `name` is the group's name in the file; empty if there is only one group.

    `first` is the line of its first row, as shown by the program that wrote the file.
    """

    name: str
    rows: int
    columns: tuple[Column, ...]
    first: int = 1

    def column(self, name: str) -> Column | None:
        """Return the column of that name."""
        return next((column for column in self.columns if column.name == name), None)


def held(group: Group) -> Group:
    """Return the group with its values in memory."""

    def in_memory(column: Column) -> Column:
        values = column.read(0, group.rows)
        return replace(column, read=lambda start, stop: values[start:stop])

    return Group(group.name, group.rows, tuple(in_memory(column) for column in group.columns))


#: opens the file and returns its groups, as often as it is called
Reading = Callable[[], AbstractContextManager[Sequence[Group]]]


@dataclass(frozen=True)
class GroupedFile:
    """A file of groups whose headings are known: those of all groups, in order of appearance.

    `noun` is the format's word for a group; `remarks` describe the parts of the file that are not used.
    """

    path: Path
    headings: tuple[Heading, ...]
    reading: Reading
    noun: str = "group"
    remarks: tuple[str, ...] = ()
    damage: tuple[str, ...] = ()  #: errors reported by the library, which can read the file nevertheless
    clock: ArrayClock | None = None  #: clock of absolute times
    began: int | None = None  #: time zero, if the file stores it separately from its times
    merged: bool = False  #: its groups are parts of one measurement, with separate times

    @property
    def origin(self) -> int | None:
        """Return the nanoseconds from 1970 UTC to time zero; None if the times are not absolute."""
        return self.began if self.clock is None else self.clock.origin

    def parts(self, wanted: Collection[int], record: int | None) -> Iterator[RowBlock]:
        """Yield the rows of one group after the other; values that a group lacks are missing."""
        with self.reading() as groups:
            for group in groups:
                for start in range(0, group.rows, PART_ROWS):
                    yield self._part(group, start, min(start + PART_ROWS, group.rows), wanted, record)
        if self.damage:
            yield self._damage(wanted)

    def _damage(self, wanted: Collection[int]) -> RowBlock:
        """Return a part without rows that reports damage."""
        import numpy as np

        faults = tuple(Fault(0, f"the file is damaged: {text}") for text in self.damage)
        return RowBlock({index: np.zeros(0) for index in wanted}, np.zeros(0, dtype=np.int64), None, faults)

    def _part(
        self, group: Group, start: int, stop: int, wanted: Collection[int], record: int | None
    ) -> RowBlock:
        import numpy as np

        columns = {index: self._numbers(group, self.headings[index], start, stop) for index in wanted}
        lines = np.arange(start, stop, dtype=np.int64) + group.first
        shown = f"{self.noun} '{group.name}'" if group.name else ""
        return RowBlock(columns, lines, self._labels(group, start, stop, record), group=shown)

    def _numbers(self, group: Group, heading: Heading, start: int, stop: int) -> NDArray[np.float64]:
        import numpy as np

        column = group.column(heading.name)
        if column is None:
            return np.full(stop - start, np.nan)
        values = column.read(start, stop)
        if len(values) != stop - start:
            raise RigctlError(
                f"the file is damaged: '{heading.name}' has other rows than the file says",
                value=f"{len(values)} of {stop - start} rows",
                where=Location(self.path),
            )
        if heading.seconds and self.clock is not None:
            return self.clock.seconds(values)
        return as_numbers(self.path, heading.name, values)

    def _labels(self, group: Group, start: int, stop: int, record: int | None) -> Labels | None:
        """Return the labels; a record column takes precedence over the name of the group."""
        import numpy as np

        column = None if record is None else group.column(self.headings[record].name)
        if column is None:
            codes = np.zeros(stop - start, dtype=np.int64)
            return Labels(codes, (group.name,), named=True) if group.name else None
        values = column.read(start, stop)
        if is_text(values):
            return labels_of_texts([_as_text(value) for value in values])
        if values.dtype.kind in "iu" and len(values) and np.abs(values.astype(np.float64)).max() > LARGEST:
            return labels_of_texts([str(value) for value in values.tolist()])
        return labels_of_numbers(as_numbers(self.path, column.name, values))


def open_groups(
    path: Path,
    reading: Reading,
    options: Options,
    noun: str = "group",
    damage: Collection[str] = (),
) -> GroupedFile:
    """Return a file of groups, ready to be read.

    Parameters
    ----------
    names: ours by theirs, so that the time column is known.
    damage: errors in the file; evaluated once the groups have been read.

    Raises
    ------
    RigctlError
        the file is empty, a column has two units, or the groups are not records.
    """
    with reading() as all_groups:
        names = ((column.name, column.unit) for group in all_groups for column in group.columns)
        options = with_time_column(names, options)
        # The order: groups without samples are left out first, so that they do not decide whether the others
        # are alike.
        groups, remarks = _with_time(all_groups, options, noun)
        if not groups:
            raise RigctlError("the file has no data", where=Location(path))
        merged = _check_alike(path, groups, options, noun)
        headings = _headings(path, groups, options, noun)
        headings, clock = _find_clock(groups, headings, options)
    chosen = _chosen(reading, {group.name for group in groups})
    return GroupedFile(
        path, headings, chosen, noun, remarks, tuple(dict.fromkeys(damage)), clock, None, merged
    )


def _find_clock(
    groups: Sequence[Group], headings: tuple[Heading, ...], options: Options
) -> tuple[tuple[Heading, ...], ArrayClock | None]:
    """Return the headings and the clock of absolute times, whose heading is then in seconds."""
    index = next((at for at, heading in enumerate(headings) if options.ours(heading.name) == "time"), None)
    if index is None:
        return headings, None
    heading = headings[index]
    columns = [(group.rows, column) for group in groups if (column := group.column(heading.name))]
    # The first and the last time of each group are enough to tell a count since an epoch from elapsed time.
    ends = [column.read(at, at + 1) for rows, column in columns for at in (0, rows - 1)]
    clock = array_clock(ends, options.unit_of(heading.name) or heading.unit)
    if clock is None:
        return headings, None
    changed = list(headings)
    changed[index] = replace(heading, unit="s", seconds=True)
    return tuple(changed), clock


def _chosen(reading: Reading, chosen: Collection[str]) -> Reading:
    """Return only the groups that are used."""

    @contextmanager
    def opened() -> Iterator[Sequence[Group]]:
        with reading() as groups:
            yield [group for group in groups if group.name in chosen and group.rows]

    return opened


def _with_time(groups: Sequence[Group], options: Options, noun: str) -> tuple[list[Group], tuple[str, ...]]:
    """Return the groups with rows; if some have a time, those without it are not samples."""
    filled = [group for group in groups if group.rows and group.columns]
    timed = [group for group in filled if any(options.ours(c.name) == "time" for c in group.columns)]
    if not timed:
        return filled, ()
    others = [group.name for group in filled if group not in timed]
    return timed, tuple(f"{noun} '{name}' has no time and is left out" for name in others)


def _check_alike(path: Path, groups: Sequence[Group], options: Options, noun: str) -> bool:
    """Return whether the groups are parts of one measurement: they have no channel in common."""
    names = [
        {options.ours(column.name) for column in group.columns} - {"time", "record", "-"} for group in groups
    ]
    parts = len(groups) > 1 and not set.intersection(*names)
    if parts and options.resample is None:
        listed = ", ".join(f"'{group.name}'" for group in groups[:5]) + (", …" if len(groups) > 5 else "")
        raise RigctlError(
            f"its {noun}s have no channel in common: they are not records, but parts of one measurement with "
            "separate times",
            value=listed,
            expected=f"one {noun} for each record, with the same channels",
            hint="Bring the channels to the same times: --resample '100 ms', say",
            where=Location(path),
        )
    return parts


def _headings(path: Path, groups: Sequence[Group], options: Options, noun: str) -> tuple[Heading, ...]:
    units: dict[str, tuple[str | None, str]] = {}
    for group in groups:
        names = [column.name for column in group.columns if options.ours(column.name) != "-"]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:  # a group's columns are found by name: the second would never be read
            where = f"in {noun} '{group.name}': " if group.name else ""
            raise RigctlError(
                f"{where}the column is there twice",
                value=twice,
                expected="different names",
                hint=f"Rename one of them in the file, or leave both out: --columns '{twice}=-'",
                where=Location(path),
            )
        for column in group.columns:
            unit, first = units.setdefault(column.name, (column.unit, group.name))
            if unit != column.unit:
                raise RigctlError(
                    f"{column.name}: its unit is not the same in every {noun}",
                    value=f"{column.unit or 'no unit'} in '{group.name}'",
                    expected=f"{unit or 'no unit'} as in '{first}'",
                    where=Location(path),
                )
    columns = [column for group in groups for column in group.columns]
    seconds = {column.name for column in columns if column.seconds}
    spent = {column.name for column in columns if column.spent}
    return tuple(
        Heading(name, unit, Location(path), name in seconds, name in spent)
        for name, (unit, _) in units.items()
    )


def common_length(path: Path, where: str, lengths: Mapping[str, int], options: Options) -> int:
    """Return the number of rows that all used columns share; `where` is for messages, e.g. ``group 'A'``.

    Raises
    ------
    RigctlError
        the numbers differ; names two of the columns.
    """
    used = {name: rows for name, rows in lengths.items() if options.ours(name) != "-"}
    first = next((name for name in used if options.ours(name) == "time"), next(iter(used), ""))
    for name, rows in used.items():
        if rows != used[first]:
            raise RigctlError(
                f"in {where}: columns of different lengths",
                value=f"{rows} values of {name}",
                expected=f"{used[first]} as of {first}",
                hint=f"Leave it out: --columns '{name}=-'",
                where=Location(path),
            )
    return used.get(first, 0)


def is_text(values: NDArray[Any]) -> bool:
    """Return whether an array has texts."""
    return values.dtype.kind in "SU" or (
        values.dtype.kind == "O" and all(isinstance(value, str | bytes) for value in values[:10])
    )


def as_numbers(path: Path, name: str, values: NDArray[Any]) -> NDArray[np.float64]:
    """Return the values as numbers.

    Raises
    ------
    RigctlError
        they are not numbers.
    """
    import numpy as np

    if values.dtype.kind in "fiub":
        return values.astype(np.float64)
    raise RigctlError(
        f"{name}: the column holds no numbers",
        value="text" if is_text(values) else str(values.dtype),
        hint=f"Leave it out: --columns '{name}=-'",
        where=Location(path),
    )


def _as_text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


@contextmanager
def overheard(library: str, messages: list[str]) -> Iterator[None]:
    """Collect a library's log messages about a file in `messages` instead of printing them."""
    names = [library, *(name for name in logging.root.manager.loggerDict if name.startswith(f"{library}."))]
    loggers = [logging.getLogger(name) for name in names]
    before = [(logger.handlers, logger.propagate) for logger in loggers]
    listener = _Listener(messages)
    for logger in loggers:
        logger.handlers, logger.propagate = [listener], False
    try:
        yield
    finally:
        for logger, (handlers, propagate) in zip(loggers, before, strict=True):
            logger.handlers, logger.propagate = handlers, propagate


class _Listener(logging.Handler):
    """Stores the text of every warning."""

    def __init__(self, messages: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._messages = messages

    def emit(self, record: logging.LogRecord) -> None:
        """Store a warning."""
        self._messages.append(record.getMessage())


@contextmanager
def clear_errors(path: Path, kind: str) -> Iterator[None]:
    """Turn a library's errors about a damaged or wrong file into clear ones."""
    try:
        yield
    except (RigctlError, MemoryError):
        raise
    except FileNotFoundError as problem:
        raise RigctlError("there is no such file", where=Location(path)) from problem
    except Exception as problem:
        _let_go(problem)
        raise RigctlError(f"the file is no {kind} file, or it is damaged", where=Location(path)) from problem


def _let_go(problem: Exception) -> None:
    """Free a library's objects of a damaged file at once, without output.

    Destructors of incomplete objects raise errors, which Python would print.
    """
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        failure: BaseException | None = problem
        while failure is not None:
            traceback.clear_frames(failure.__traceback__)
            failure = failure.__context__
        gc.collect()
    finally:
        sys.unraisablehook = hook


def missing_extra(extra: str, package: str, path: Path) -> RigctlError:
    """Return the error for a file whose reader is not installed."""
    return RigctlError(
        f"this kind of file needs {package}, which is not installed",
        hint=f"Install it: pip install 'rigctl[{extra}]'",
        where=Location(path),
    )
