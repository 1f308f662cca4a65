"""Row-by-row checks of imported samples, independent of the division into parts.

In: parts of a file as written. Out: the same rows in SI, in the columns of the run, without those that
are bad, and a fault for each of these. The checker keeps what it has to know of earlier parts (the open
record, its newest time, the records that have ended), so that where a part ends makes no difference.

A reading that is impossible is a missing value; a command that is impossible is a fault of its row, since
what was really commanded is unknown (docs/decisions/0163-an-impossible-command-is-a-fault-of-its-row.md).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, repeat
from typing import TYPE_CHECKING, Final

import numpy as np

from rigctl.dataset.importing.cells.labels import BETWEEN, IMPOSSIBLE, LabelBook, describe_label
from rigctl.dataset.importing.cells.missing_values import NO_NUMBER
from rigctl.dataset.importing.columns import Assigned
from rigctl.dataset.importing.formats.table import BEYOND_LIMITS, KEPT_FAULTS, NOT_INCREASING, Fault, RowBlock
from rigctl.units import show

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigctl.rig.layout import Layout

#: largest plausible time, s: three centuries, even if time zero is the year 1904
LATEST: Final = 1e10
#: error of a number that was rounded, converted between units or stored in 32 bits, as a share of the range
_ROUNDING: Final = 1e-4


@dataclass(frozen=True)
class Stretch:
    """Consecutive rows ``start`` to ``stop`` (exclusive) of one record, or between records.

    `record` counts the records of the file from 0, −1 for none; `begins` is false if the stretch continues
    from the previous part.
    """

    record: int
    start: int
    stop: int
    begins: bool


@dataclass(frozen=True)
class Checked:
    """The valid rows of a part, SI, shape (n, ``layout.columns``), and the faults of the others.

    `faults` describes the first of the `bad_rows`.
    """

    block: NDArray[np.float64]
    stretches: tuple[Stretch, ...]
    faults: tuple[Fault, ...]
    bad_rows: int = 0


class Checker:
    """Checks a file part by part and keeps track of the open record.

    Parameters
    ----------
    assigned: the assigned columns of the file.
    layout: the columns of the run.
    missing: numbers that mark missing values, as written in the file.
    """

    def __init__(self, assigned: Sequence[Assigned], layout: Layout, missing: Sequence[float] = ()) -> None:
        self._missing = marks_of(missing)
        self._columns = [column for column in assigned if column.kind not in ("record", "clock")]
        self._layout = layout
        self.book = LabelBook()
        self.record_ids: list[int] = []  #: names of the records, in the order of the file
        self._open: int | None = None
        self._ended: set[int] = set()
        self.impossible: Counter[str] = Counter()  #: readings outside their range, by channel
        self._latest = -np.inf
        self._taken: int | None = None  # the label of the last valid row

    def take(self, part: RowBlock) -> Checked:
        """Check the next rows of the file."""
        values = {column.name: self._values(column, part) for column in self._columns}
        bad = InvalidRows(part)
        # Values first, then the record, then the order of time: a row has its first fault only, and a row
        # without a usable time or record must not count in the order of the others.
        self._check_values(values, bad)
        ids = self._ids(part, bad)
        ordered = self._in_order(values["time"], ids, bad)
        columns = [values.get(name, ids.astype(np.float64)) for name in self._layout.columns]
        block = np.column_stack(columns)
        good = bad.others
        if not good.all():
            block = block[good]
            kept = np.concatenate([[0], np.cumsum(good)]).tolist()
            ordered = [(label, kept[start], kept[stop]) for label, start, stop in ordered]
        stretches = tuple(self._stretch(label, start, stop) for label, start, stop in ordered if stop > start)
        faults = tuple(sorted((*part.faults, *bad.faults()), key=lambda fault: fault.line))
        return Checked(block, stretches, faults, len(part.faults) + part.more_faults + bad.count)

    def _values(self, column: Assigned, part: RowBlock) -> NDArray[np.float64]:
        """Return a column in SI, with marks of missing values and impossible readings as NaN."""
        written = part.columns[column.index]
        if column.kind == "time":
            return to_si(column, written)
        values = to_si(column, without_marks(written, self._missing))
        if column.kind == "command":  # unlike a missing reading, an unknown command is a fault of its row
            return values
        outside = impossible(column, values)
        count = int(outside.sum())
        if not count:
            return values
        self.impossible[column.name] += count
        return np.where(outside, np.nan, values)

    def _stretch(self, label: int, start: int, stop: int) -> Stretch:
        """Return a stretch of valid rows, and the record that they begin or continue."""
        begins = label != self._taken
        if begins and label != BETWEEN:
            self.record_ids.append(label)
        self._taken = label
        return Stretch(len(self.record_ids) - 1 if label != BETWEEN else -1, start, stop, begins)

    def _check_values(self, values: Mapping[str, NDArray[np.float64]], bad: InvalidRows) -> None:
        time = values["time"]
        bad.add(np.flatnonzero(np.isnan(time)), "time: the value is missing")
        far = np.flatnonzero(np.isfinite(time) & (np.abs(time) > LATEST))
        texts = [f"{value:.3g} s" for value in time[far].tolist()]
        bad.add(far, "time: too far away", texts, repeat(f"within {LATEST:g} s of zero"))
        for column in self._columns:
            column_values = values[column.name]
            bad.add(np.flatnonzero(np.isinf(column_values)), f"{column.name}: not a finite number")
            if column.positions is not None:
                wrong = np.flatnonzero(
                    ~np.isnan(column_values) & ~np.isin(column_values, list(column.positions))
                )
                expected = ", ".join(f"{value:g}" for value in sorted(column.positions))
                texts = [f"{value:g}" for value in column_values[wrong].tolist()]
                bad.add(wrong, f"{column.name}: no such position", texts, repeat(expected))
            if column.kind == "command":
                bad.add_beyond_limits(column, column_values)

    def _ids(self, part: RowBlock, bad: InvalidRows) -> NDArray[np.int64]:
        """Return the record of each row; one for all rows if the file has none."""
        labels = part.labels
        if labels is None:
            self.book.id_of("0")
            return np.zeros(len(part.lines), dtype=np.int64)
        known = np.array([self.book.id_of(text, named=labels.named) for text in labels.texts], dtype=np.int64)
        ids = known[labels.codes]
        wrong = np.flatnonzero(ids == IMPOSSIBLE)
        bad.add(
            wrong, "record: not a whole number", [labels.texts[at] for at in labels.codes[wrong].tolist()]
        )
        return ids

    def _in_order(
        self, time: NDArray[np.float64], ids: NDArray[np.int64], bad: InvalidRows
    ) -> list[tuple[int, int, int]]:
        """Check that time increases in a record and never falls between records, and no record reappears.

        Returns the label, the first row and the row after the last of every stretch of equal labels.
        """
        found = []
        rows = np.flatnonzero((np.abs(time) <= LATEST) & (ids != IMPOSSIBLE))
        for first, last in _equal(ids[rows]):
            rows_of_label = rows[first:last]
            label = int(ids[rows_of_label[0]])
            begins = label != self._open
            if begins and label != BETWEEN and label in self._ended:
                name = describe_label(self.book.labels[label]).removeprefix("record ")
                bad.add(rows_of_label, "record: it has ended before", repeat(name))
                continue
            if begins:
                self._begin(label)
            # Compared with the latest time so far, not with the previous row: after one step back all rows up
            # to the old time are bad, not only the first.
            times = np.maximum.accumulate(np.concatenate([[self._latest], time[rows_of_label]]))
            # between records, where the rate changes, two samples may have the same time
            stands = (time[rows_of_label] == times[:-1]) & (label != BETWEEN)
            back = np.flatnonzero((time[rows_of_label] < times[:-1]) | stands)
            bad.add(
                rows_of_label[back],
                NOT_INCREASING,
                [f"{value:.9g} s" for value in time[rows_of_label[back[:KEPT_FAULTS]]].tolist()],
                [f"more than {value:.9g} s, or a new record" for value in times[back[:KEPT_FAULTS]].tolist()],
            )
            self._latest = float(times[-1])
            found.append((label, int(rows_of_label[0]), int(rows_of_label[-1]) + 1))
        return found

    def _begin(self, label: int) -> None:
        if self._open is not None:
            self._ended.add(self._open)
        self._open, self._latest = label, -np.inf


class InvalidRows:
    """The invalid rows, with the first fault of each."""

    def __init__(self, part: RowBlock) -> None:
        self._part = part
        self._found: dict[int, Fault] = {}
        self.count = 0  #: number of rows with a fault
        self.others = np.ones(len(part.lines), dtype=bool)  #: rows without a fault

    def add(
        self,
        rows: NDArray[np.int64],
        what: str,
        values: Iterable[str | None] = repeat(None),
        expected: Iterable[str | None] = repeat(None),
    ) -> None:
        """Add a fault for some rows, unless they have one: the text found and what was expected."""
        self.count += int(self.others[rows].sum())
        for row, value, wanted in zip(rows.tolist(), values, expected, strict=False):
            if len(self._found) >= KEPT_FAULTS:
                break
            if row not in self._found:
                line = int(self._part.lines[row])
                self._found[row] = Fault(
                    line, what, value, wanted, group=self._part.group, path=self._part.path
                )
        self.others[rows] = False

    def add_beyond_limits(self, column: Assigned, values: NDArray[np.float64]) -> None:
        """Add a fault for each command, SI, which its actuator cannot have taken."""
        rows = np.flatnonzero(impossible(column, values))
        found = [_beyond_limits(column, value) for value in values[rows[:KEPT_FAULTS]].tolist()]
        for what, _, expected in found[:1]:
            self.add(rows, what, [text for _, text, _ in found], repeat(expected))

    def faults(self) -> Iterator[Fault]:
        """Return one fault for each bad row."""
        yield from self._found.values()


def _equal(ids: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Yield the start and end of each stretch of equal ids, in order."""
    if not len(ids):
        return []
    edges = np.flatnonzero(ids[1:] != ids[:-1]) + 1
    return list(pairwise([0, *edges.tolist(), len(ids)]))


def marks_of(missing: Iterable[float]) -> NDArray[np.float64]:
    """Return the numbers that mark missing values, also as a file of 32-bit numbers stores them."""
    marks = np.array([*NO_NUMBER, *missing])
    with np.errstate(over="ignore"):
        stored = marks.astype(np.float32).astype(np.float64)
    return np.unique(np.concatenate([marks, stored[np.isfinite(stored)]]))


def without_marks(values: NDArray[np.float64], marks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values as written in the file, NaN for those that are marks."""
    if not len(values) or np.nanmax(np.abs(values), initial=0.0) < np.abs(marks).min():
        return values
    marked = np.isin(values, marks)
    return np.where(marked, np.nan, values) if marked.any() else values


def impossible(column: Assigned, values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which SI values are outside the range of the column's channel or the limits of its level."""
    if column.possible is None:
        return np.zeros(values.shape, dtype=bool)
    low, high = column.possible
    span = (
        high - low
        if np.isfinite(high - low)
        else max(abs(end) for end in column.possible if np.isfinite(end))
    )
    slack = _ROUNDING * span
    return np.asarray(np.isfinite(values) & ((values < low - slack) | (values > high + slack)))


def _beyond_limits(column: Assigned, value: float) -> tuple[str, str, str]:
    """Return what is wrong with a command, SI, which its actuator cannot have taken: the fault, the value and
    what was expected, in the unit of the file.
    """
    unit = column.unit.text if column.unit is not None and column.unit.text else column.shown
    low, high = column.possible or (-np.inf, np.inf)
    ends = [show(end, unit, digits=6) for end in (low, high) if np.isfinite(end)]
    expected = (
        " to ".join(ends) if len(ends) == 2 else f"at {'least' if np.isfinite(low) else 'most'} {ends[0]}"
    )
    return f"{column.name}: {BEYOND_LIMITS}", show(value, unit, digits=6), expected


def to_si(column: Assigned, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a column's values in SI."""
    if column.unit is None:
        return values
    offset = 0.0 if column.difference else column.unit.offset
    return values * column.unit.factor + offset
