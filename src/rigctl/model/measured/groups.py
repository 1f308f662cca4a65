"""Groups of replicates: records with the same condition, commands and start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.dataset.conditions import cluster
from rigctl.model.measured.record import MeasuredRecord

#: initial values closer than this, as a share of the channel's range, are the same
SAME_START = 0.02
#: command times closer than this are the same, s
_SAME_TIME = 0.05
_DIGITS = 5


def group_numbers(records: Sequence[MeasuredRecord]) -> list[int]:
    """The number of each record's group; groups are numbered in the order of their first records."""
    starts = _starts(records)
    numbers: dict[object, int] = {}
    return [
        numbers.setdefault((_condition(record), _commands(record), tuple(start)), len(numbers))
        for record, start in zip(records, starts, strict=True)
    ]


def _condition(record: MeasuredRecord) -> tuple[tuple[str, str], ...]:
    return tuple(sorted((name, f"{value:.{_DIGITS}g}") for name, value in record.condition.items()))


def _commands(record: MeasuredRecord) -> tuple[object, ...]:
    # commands of replicates agree in their values, and only roughly in their times
    times = np.round((record.switch_times - record.times[0]) / _SAME_TIME).astype(int)
    rows = (tuple(f"{value:.{_DIGITS}g}" for value in row) for row in record.inputs)
    return tuple(zip(times.tolist(), rows, strict=True))


def _starts(records: Sequence[MeasuredRecord]) -> list[list[float]]:
    """The initial value of each channel, equal for records that start alike."""
    if not records:
        return []
    columns = []
    for index in range(records[0].values.shape[1]):
        first = [first_reading(record, index) for record in records]
        present = [record.values[np.isfinite(record.values[:, index]), index] for record in records]
        every = np.concatenate(present) if present else np.empty(0)
        width = SAME_START * float(np.ptp(every)) if every.size else 0.0
        columns.append([-1.0 if np.isnan(value) else value for value in cluster(first, width)])
    return [list(row) for row in zip(*columns, strict=True)]


def first_reading(record: MeasuredRecord, output: int, count: int = 5) -> float:
    """The median of an output's first readings, in the first phase; NaN if there are none from the start."""
    if record.switch_times.size > 1 and record.times[0] > record.switch_times[1]:
        return float("nan")
    values = record.values[record.phase == 0, output]
    ordered = sorted(values[np.isfinite(values)][:count].tolist())
    if not ordered:
        return float("nan")
    half = len(ordered) // 2
    return float(ordered[half]) if len(ordered) % 2 else 0.5 * (ordered[half - 1] + ordered[half])
