"""The input of a noise estimate: the measured channels of one record, without any model."""

from __future__ import annotations

from dataclasses import dataclass

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
