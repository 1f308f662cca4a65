"""Remarks on measurements that are not errors but matter for trusting a verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.dataset.gaps import find_gap
from rigctl.model.measured.note import Note
from rigctl.model.measured.record import MeasuredRecord


def _seconds(value: float) -> str:
    return f"{value:.3g} s" if value >= 1.0 else f"{1e3 * value:.3g} ms"


def notes(records: Sequence[MeasuredRecord], outputs: Sequence[str]) -> Iterator[str | Note]:
    """Imprecise switch times, gaps in time, missing values, channels that never change."""
    half = max((float(record.switch_half.max(initial=0.0)) for record in records), default=0.0)
    if half > 0.0:
        text = f"Commands were written down with the samples: their times are known to ±{_seconds(half)}"
        yield Note(text, "taken")
    jitter = max((float(record.jitter.max(initial=0.0)) for record in records), default=0.0)
    if jitter > 0.0:
        yield f"By the rig file, the times at which actuators act scatter by ±{_seconds(2.0 * jitter)} (95 %)"
    yield from _gaps(records)
    for index, name in enumerate(outputs):
        missing = sum(int((~record.here[:, index]).sum()) for record in records)
        if missing:
            total = sum(record.times.size for record in records)
            yield f"{name} is missing in {missing} of {total} samples: they are left out"
        if _never_changes([record.values[:, index] for record in records if record.times.size > 1]):
            yield (
                f"{name} never changes: the sensor may be dead, or the channel is not connected, "
                "and its noise cannot be told"
            )


def _gaps(records: Sequence[MeasuredRecord]) -> Iterator[str]:
    """Rows of a table are not samples and have no gaps."""
    gaps = [(record, gap) for record in records if (gap := find_gap(record.times)) is not None]
    if gaps:
        record, gap = max(gaps, key=lambda one: one[1].length)
        yield (
            f"gaps in time in {len(gaps)} of {len(records)} records: what happened in them is not judged; "
            f"the longest: {gap.length:.4g} s from {gap.start:.4g} s on in {record.label}"
        )


def _never_changes(columns: Sequence[NDArray[np.float64]]) -> bool:
    """A single value in all of them, read more than once."""
    values = [column[np.isfinite(column)] for column in columns]
    values = [column for column in values if column.size]
    if not values or sum(column.size for column in values) < 2:
        return False
    return max(float(column.max()) for column in values) == min(float(column.min()) for column in values)
