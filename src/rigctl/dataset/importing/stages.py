"""Optional processing of the rows of a file between reading and checking.

It needs more than one row at a time, so that the file is held in memory; one that is too long is refused.

The order: marks of missing values are left out as soon as rows are read, since whatever follows would
take them for readings; then resampling, as channels with clocks of their own have no common rows before
it; then times that do not increase are dropped, spread or made the beginning of a record; last the
division into records, which needs all of that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from rigctl.dataset.importing.cells.increasing import spread
from rigctl.dataset.importing.cells.sentinels import Sentinels, blanked, remark, without_marked_times
from rigctl.dataset.importing.checks import marks_of
from rigctl.dataset.importing.columns import Assigned, places_of
from rigctl.dataset.importing.formats.groups import GroupedFile
from rigctl.dataset.importing.formats.table import PART_ROWS, Labels, RowBlock, Source, cut
from rigctl.dataset.importing.options import Options
from rigctl.dataset.importing.resampling import resample
from rigctl.dataset.importing.splitting import read_split, split_at_restarts, split_rows, stretches
from rigctl.errors import Location, RigctlError
from rigctl.tasks import Countdown

_VALUED: Final = ("channel", "command", "other")
_TIMES: Final = ("time", "clock")
#: limit of the numbers in memory, bytes
_MOST: Final = 2_000_000_000


@dataclass
class Stages:
    """The stages required by the options; `remarks` describe what the last pass changed, `rows` is the
    number of rows that it read."""

    options: Options
    assigned: Sequence[Assigned]
    on_progress: Callable[[str], None] = lambda _: None
    remarks: list[str] = field(default_factory=list)
    marks: Mapping[int, Mapping[float, int]] = field(default_factory=dict)
    rows: int = 0

    def __post_init__(self) -> None:
        self.valued = [column.index for column in self.assigned if column.kind in _VALUED]
        times = [
            column.index
            for column in self.assigned
            if column.kind in _TIMES and not column.heading.seconds  # where a mark is not a date
        ]
        keep = "none" in self.options.missing
        self.sentinels = Sentinels([] if keep else [*self.valued, *times], times)

    def find_marks(self) -> bool:
        """After a pass, take the numbers that turned out to be marks of missing values for the next passes;
        return whether there are any.
        """
        # Once: after the second pass the marks are gone from the columns, and nothing new is to be found.
        self.marks = self.sentinels.found() if not self.marks else {}
        return bool(self.marks)

    def mark_remarks(self) -> Iterator[str]:
        """Return a remark on the marks of each column."""
        for column in self.assigned:
            if column.index in self.marks and column.kind != "time":  # each of which is a bad row
                yield remark(column.name, self.marks[column.index])

    def _read(self, source: Source, wanted: Sequence[int], record: int | None) -> Iterator[RowBlock]:
        """Yield the rows of the file without marks of missing values."""
        numbers = marks_of(self.options.missing_numbers).tolist()
        every = {index: (*numbers, *self.marks.get(index, ())) for index in self.valued}
        times: dict[int, tuple[float, ...]] = {}
        for column in self.assigned:
            if column.kind in _TIMES and column.index in self.marks:
                # a row without a time is a bad one; a channel's own clock may lack some
                (times if column.kind == "time" else every)[column.index] = (*self.marks[column.index],)
        known, self.rows = self.rows, 0  # of an earlier pass
        read = Countdown(f"Reading {source.path.name}", self.on_progress)
        for part in source.parts(wanted, record):
            self.rows += len(part.lines)
            if known:
                read(self.rows, known)
            elif self.rows >= PART_ROWS:
                self.on_progress(f"Reading {source.path.name}: {self.rows} rows so far")
            self.sentinels.take(part)
            yield blanked(without_marked_times(part, times, "time"), every)

    @property
    def needed(self) -> bool:
        """Whether any stage is required."""
        options = self.options
        return options.time_policy != "refuse" or options.split is not None or options.resample is not None

    def parts(self, source: Source) -> Iterator[RowBlock]:
        """Yield the rows of a file, ready to be checked."""
        split = read_split(self.options.split)
        wanted, record = places_of(self.assigned)
        headings = {heading.name: index for index, heading in enumerate(source.headings)}
        if split is not None and split.way == "column":
            numeric = {name for c in self.assigned if c.unit is not None for name in (c.name, c.heading.name)}
            if split.what not in numeric:
                if split.what not in headings:
                    raise _no_column(split.what or "", [*headings, *numeric], source)
                record = headings[split.what]
        if not self.needed:
            self._check_clocks(source)
            yield from self._read(source, wanted, record)
            return
        self.remarks = []
        if self.options.resample is None:
            self._check_clocks(source)
        times = [column.index for column in self.assigned if column.kind == "time"]
        if not times:
            raise RigctlError("the rows cannot be put in order without times", expected="a column 'time [s]'")
        time = times[0]
        merged = isinstance(source, GroupedFile) and source.merged
        wholes = _wholes(source, self._read(source, wanted, record), wanted, merged=merged)
        for whole in self._resampled(wholes):
            if self.options.time_policy == "split":
                done = split_at_restarts(whole, time)
            else:
                done = self._mended(whole, time) if self.options.time_policy != "refuse" else whole
            if split is not None:
                done = split_rows(done, split, self.assigned, headings)
            yield from _slices(done)

    def _check_clocks(self, source: Source) -> None:
        """Refuse channels with separate clocks unless they are resampled."""
        clock = next((column for column in self.assigned if column.kind == "clock"), None)
        if clock is not None:
            raise RigctlError(
                f"{clock.name} has a clock of its own",
                expected="--resample with a step, '100 ms', or the name of a column whose times are taken",
                where=clock.heading.where.or_else(Location(source.path)),
            )

    def _resampled(self, wholes: Iterator[RowBlock]) -> Iterator[RowBlock]:
        """Resample files or groups to common times if requested."""
        to = self.options.resample
        for whole in wholes:
            if to is None:
                yield whole
                continue
            resampled, remarks = resample(whole, self.assigned, to, self.options.time_policy)
            self.remarks += [remark for remark in remarks if remark not in self.remarks]
            yield resampled

    def _mended(self, part: RowBlock, time: int) -> RowBlock:
        """Drop rows whose time does not increase, or spread equal times."""
        import numpy as np

        times = part.columns[time].copy()
        good = np.ones(len(times), dtype=bool)
        for start, stop, _ in stretches(part):
            span = slice(start, stop)
            if self.options.time_policy == "spread":
                times[span] = spread(times[span])
            before = np.fmax.accumulate(np.concatenate([[-np.inf], times[span]]))[:-1]
            good[span] = ~(times[span] <= before)
        moved, dropped = int((times != part.columns[time])[good].sum()), int((~good).sum())
        if self.options.time_policy == "spread" and moved:
            self.remarks.append(f"{moved} rows had the time of the row before them, and were spread evenly")
        if dropped and self.options.time_policy == "drop":
            line = int(part.lines[np.flatnonzero(~good)[0]])
            self.remarks.append(
                f"{dropped} rows whose time does not increase were dropped, the first of them on line {line}"
            )
            part = cut(part, good)
            times = times[good]
        return replace(part, columns={**part.columns, time: times})


def _slices(part: RowBlock) -> Iterator[RowBlock]:
    """Yield a whole file in parts; its faults are in the first."""
    rows = len(part.lines)
    for start in range(0, max(rows, 1), PART_ROWS):
        piece = cut(part, slice(start, start + PART_ROWS))
        yield piece if start == 0 else replace(piece, faults=(), more_faults=0)


def _wholes(
    source: Source, read: Iterator[RowBlock], wanted: Sequence[int], *, merged: bool
) -> Iterator[RowBlock]:
    """Yield all rows of each file, or of each group in a file with groups, as one part.

    Parameters
    ----------
    merged: groups are parts of one measurement, and form one part.

    Raises
    ------
    RigctlError
        there are too many rows.
    """
    parts: list[RowBlock] = []
    size = 0
    for part in read:
        if merged:
            part = replace(part, labels=None, group="")  # noqa: PLW2901 - the same rows
        if parts and (part.path, part.group) != (parts[0].path, parts[0].group):
            yield joined(parts, wanted)
            parts, size = [], 0
        size += sum(values.nbytes for values in part.columns.values())
        if size > _MOST:
            raise RigctlError(
                f"the file has more than {_MOST / 1e9:.0f} GB of numbers, too many to be held at once",
                hint="Divide it into several files, or bring it in without --split, --times and --resample",
                where=Location(part.path or source.path),
            )
        parts.append(part)
    if parts:
        yield joined(parts, wanted)


def joined(parts: Sequence[RowBlock], wanted: Sequence[int]) -> RowBlock:
    """Join consecutive parts."""
    import numpy as np

    columns = {index: np.concatenate([part.columns[index] for part in parts]) for index in wanted}
    lines = np.concatenate([part.lines for part in parts])
    codes = []
    indices: dict[str, int] = {}
    for part in parts:
        if part.labels is None:
            continue
        known = [indices.setdefault(text, len(indices)) for text in part.labels.texts]
        codes.append(np.array(known, dtype=np.int64)[part.labels.codes])
    labelled = [part.labels for part in parts if part.labels is not None]
    labels = None
    if labelled:
        labels = Labels(np.concatenate(codes), tuple(indices), all(label.named for label in labelled))
    faults = tuple(fault for part in parts for fault in part.faults)
    more = sum(part.more_faults for part in parts)
    first = parts[0]
    return RowBlock(columns, lines, labels, faults, first.group, more, first.path)


def _no_column(name: str, names: Sequence[str], source: Source) -> RigctlError:
    from rigctl.errors import unknown_name

    problem = unknown_name("column to split by", name, [name for name in names if name])
    return problem.at(Location(source.path))
