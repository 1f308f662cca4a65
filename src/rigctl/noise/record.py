"""The input of a noise estimate: the measured channels of one record, without any model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class NoiseRecord:
    """One record of measurements.

    Parameters
    ----------
    times: (n) s, increasing.
    values: (n, channels) SI, NaN where a value is missing.
    condition: number of the operating point; records that share it are replicates.
    phase: (n) index of the period of constant commands of each sample.

    Raises
    ------
    ValueError
        inconsistent shapes, or times that do not increase.
    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]
    condition: int
    phase: NDArray[np.intp]

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.shape[0] != self.times.size:
            raise ValueError(f"values have shape {self.values.shape}, times {self.times.shape}")
        if self.phase.shape != self.times.shape:
            raise ValueError(f"phase has shape {self.phase.shape}, times {self.times.shape}")
        if self.times.size > 1 and not np.all(np.diff(self.times) > 0.0):
            raise ValueError("times must increase inside a record")


#: a channel whose readings are further apart than this many rows has rows of its own
_OWN_ROWS = 1.5


def own_spacing(times: Sequence[NDArray[np.float64]], spacing: float) -> float:
    """The usual time between the readings of one channel, s: `spacing`, that between rows, unless most rows
    are without it.

    Where a bench is several devices, a row holds the readings of one of them, and between two readings of a
    channel lie the rows of the others.
    """
    gaps = np.concatenate([np.diff(each) for each in times]) if times else np.empty(0)
    usual = float(np.median(gaps)) if gaps.size else spacing
    return usual if usual > _OWN_ROWS * spacing else spacing


def rows_of(
    records: Sequence[NoiseRecord], ok: Sequence[NDArray[np.bool_]], channel: int, spacing: float
) -> tuple[Sequence[NoiseRecord], Sequence[NDArray[np.bool_]], float]:
    """The records and masks as they are, or with the rows of one channel alone if it has rows of its own; and
    the usual time between them, s."""
    read = [np.isfinite(record.values[:, channel]) for record in records]
    own = own_spacing([record.times[rows] for record, rows in zip(records, read, strict=True)], spacing)
    if own == spacing:
        return records, ok, spacing
    alone = [
        replace(record, times=record.times[rows], values=record.values[rows], phase=record.phase[rows])
        for record, rows in zip(records, read, strict=True)
    ]
    return alone, [mask[rows] for mask, rows in zip(ok, read, strict=True)], own
