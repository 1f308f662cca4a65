"""What must hold for imported samples, row by row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from rigctl.dataset.importing.columns import Assigned
from rigctl.dataset.importing.table import Fault

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: number of a row that belongs to no record
BETWEEN: Final = -1.0


@dataclass(frozen=True)
class Stretch:
    """Consecutive rows ``start`` to ``stop`` (exclusive) of one record, or between records."""

    label: float
    start: int
    stop: int


def stretches(labels: NDArray[np.float64]) -> list[Stretch]:
    """The runs of equal labels, in order."""
    if not len(labels):
        return []
    edges = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    bounds = [0, *edges.tolist(), len(labels)]
    return [Stretch(float(labels[start]), start, stop) for start, stop in pairwise(bounds)]


def record_labels(values: NDArray[np.float64] | None, rows: int) -> NDArray[np.float64]:
    """The record of each row: one for all where the file does not say; missing or negative is between."""
    if values is None:
        return np.zeros(rows)
    return np.where(np.isnan(values) | (values < 0), BETWEEN, values)


def find_faults(
    columns: Mapping[Assigned, NDArray[np.float64]],
    time: NDArray[np.float64],
    labels: NDArray[np.float64],
    lines: NDArray[np.int64],
) -> Iterator[tuple[int, Fault]]:
    """Every row that cannot be taken in: its index and what is wrong with it.

    Parameters
    ----------
    columns: SI values of all columns of the file, shape (n,) each.
    time, labels: time and record of each row.
    lines: of the rows in the file.
    """
    for column, values in columns.items():
        for index in np.flatnonzero(np.isinf(values)).tolist():
            yield index, Fault(int(lines[index]), f"{column.name}: not a finite number")
    for index in np.flatnonzero(np.isnan(time)).tolist():
        yield index, Fault(int(lines[index]), "time: the value is missing")
    for index in np.flatnonzero(labels != np.floor(labels)).tolist():
        yield index, Fault(int(lines[index]), "record: not a whole number", f"{labels[index]:g}")
    yield from _position_faults(columns, lines)
    yield from _order_faults(time, labels, lines)


def _position_faults(
    columns: Mapping[Assigned, NDArray[np.float64]], lines: NDArray[np.int64]
) -> Iterator[tuple[int, Fault]]:
    for column, values in columns.items():
        if column.positions is None:
            continue
        wrong = ~np.isnan(values) & ~np.isin(values, list(column.positions))
        expected = ", ".join(f"{value:g}" for value in sorted(column.positions))
        for index in np.flatnonzero(wrong).tolist():
            yield (
                index,
                Fault(int(lines[index]), f"{column.name}: no such position", f"{values[index]:g}", expected),
            )


def _order_faults(
    time: NDArray[np.float64], labels: NDArray[np.float64], lines: NDArray[np.int64]
) -> Iterator[tuple[int, Fault]]:
    """Time goes on inside a record, and a record that has ended does not come back."""
    ended: set[float] = set()
    for stretch in stretches(labels):
        rows = slice(stretch.start, stretch.stop)
        if stretch.label in ended and stretch.label != BETWEEN:
            for index in range(stretch.start, stretch.stop):
                yield index, Fault(int(lines[index]), "record: it has ended before", f"{stretch.label:g}")
            continue
        ended.add(stretch.label)
        times = np.where(np.isnan(time[rows]), -np.inf, time[rows])
        latest = np.maximum.accumulate(times)
        back = np.flatnonzero((times[1:] <= latest[:-1]) & np.isfinite(times[1:])) + 1
        for index in (back + stretch.start).tolist():
            before = latest[index - stretch.start - 1]
            yield (
                index,
                Fault(
                    int(lines[index]),
                    "time: it does not go on inside a record",
                    f"{time[index]:.9g} s",
                    f"more than {before:.9g} s, or the number of a new record",
                ),
            )
