"""What an error of a sensor may depend on: time, what is read, and how fast that changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl.model.measured.record import MeasuredRecord

Floats = NDArray[np.float64]
#: what a disturbance depends on; in a table, "time" is its inputs
View: TypeAlias = Literal["time", "reading", "rate"]


def reading_bases(
    records: Sequence[MeasuredRecord], read: Sequence[Floats], knots: int, spacing: float
) -> dict[View, list[Floats]]:
    """(n, functions) of each record for every view of an error of one channel, of which `read` is said.

    - "time": tents at the knots; of a table, whose `spacing` is 0, tents over each input that varies;
    - "reading": an offset, a gain and a bend over the range that the channel covers;
    - "rate": the time derivative, which a lag multiplies; a table has none.
    """
    low, high = min(float(x.min()) for x in read), max(float(x.max()) for x in read)
    place = [(2.0 * x - low - high) / ((high - low) or 1.0) for x in read]
    found: dict[View, list[Floats]] = {}
    found["reading"] = [np.column_stack([np.ones_like(x), x, 1.5 * x**2 - 0.5]) for x in place]
    if spacing > 0.0:
        found["time"] = [tents(r.times - r.switch_times[0], knots, spacing) for r in records]
        if min(x.size for x in read) > 1:
            found["rate"] = [
                np.gradient(x, record.times)[:, None] for x, record in zip(read, records, strict=True)
            ]
        return found
    varying = _inputs(records)
    if varying[0].shape[1]:
        found["time"] = [
            np.concatenate([tents(column, knots, 1.0 / (knots - 1)) for column in x.T], axis=1)
            for x in varying
        ]
    return found


def tents(x: Floats, knots: int, spacing: float) -> Floats:
    """(n, knots): ``max(0, 1 − |x/spacing − k|)``."""
    distance = np.abs(x[:, None] / spacing - np.arange(knots))
    return np.maximum(1.0 - distance, 0.0)


def _inputs(records: Sequence[MeasuredRecord]) -> list[Floats]:
    """(n, varying inputs) of each record at its samples, from 0 to 1."""
    values = [
        record.inputs[np.searchsorted(record.switch_times, record.times, side="right") - 1]
        for record in records
    ]
    low = np.min([x.min(axis=0) for x in values], axis=0)
    high = np.max([x.max(axis=0) for x in values], axis=0)
    moved = high > low
    return [(x[:, moved] - low[moved]) / (high[moved] - low[moved]) for x in values]
