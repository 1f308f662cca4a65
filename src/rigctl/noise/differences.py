"""Noise from differences along a record: the last method that uses the data; it cannot show correlation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.record import NoiseRecord

#: order of the difference: a cubic signal leaves nothing
ORDER = 4
_WEIGHTS = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
#: least number of differences
FEWEST = 10


def difference_noise(
    records: Sequence[NoiseRecord], ok: Sequence[NDArray[np.bool_]], channel: int
) -> tuple[float, int]:
    """Sigma (SI) of one channel from fourth differences inside the phases, and their number.

    ``d_i = x_(i−2) − 4·x_(i−1) + 6·x_i − 4·x_(i+1) + x_(i+2)`` of white noise has the variance 70·σ²; the
    median of ``|d|`` is 0.6745 of its standard deviation and is robust to a few transients. Correlated noise
    is underestimated. Zero if there are no differences.

    Source: von Neumann et al., Ann. Math. Stat. 12 (1941) 153; Gasser, Sroka & Jennen-Steinmetz, Biometrika
    73 (1986) 625.
    """
    magnitudes = []
    for record, good in zip(records, ok, strict=True):
        if record.times.size <= ORDER:
            continue
        stacked = np.lib.stride_tricks.sliding_window_view(record.values[:, channel], ORDER + 1)
        complete = np.lib.stride_tricks.sliding_window_view(good[:, channel], ORDER + 1).all(axis=1)
        complete &= record.phase[ORDER:] == record.phase[:-ORDER]
        magnitudes.append(np.abs(stacked[complete] @ _WEIGHTS))
    differences = np.concatenate(magnitudes) if magnitudes else np.empty(0)
    if differences.size == 0:
        return 0.0, 0
    scale = float(np.median(differences)) / 0.6745
    return scale / float(np.sqrt(np.sum(_WEIGHTS**2))), int(differences.size)
