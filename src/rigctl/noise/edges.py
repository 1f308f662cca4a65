"""Edges that the sampling does not resolve: readings that say more of the moment than of the value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: a second difference of so many of its own standard deviations is an edge
THRESHOLD = 4.0
#: standard deviation of a second difference of white noise, in those of the noise
_SECOND = float(np.sqrt(6.0))
#: a channel that bends so in more than this share of a record does so everywhere: that is its signal
_MOST = 0.25
#: spacings that differ by more than this from the usual one are gaps
_GAP = 1.5


def find_edges(
    times: NDArray[np.float64], values: NDArray[np.float64], sigma: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which samples lie on an edge that is shorter than the sampling.

    Where the signal bends by far more than its noise from one sample to the next, the reading hangs on when
    within the interval it was taken, and on every detail of how the edge runs: the pressure of a chamber when
    its valve opens rings at hundreds of hertz for some samples. Such readings weigh hundreds of sigmas, have
    a minimum for every beat, and tell of the clock rather than of the bench. With
    ``d_i = y_(i+1) − 2y_i + y_(i−1)`` the three samples of every ``|d_i| > THRESHOLD·√6·σ`` are on an edge;
    none of them where that is true of a quarter of the record: a sweep at a high frequency is no edge.

    Parameters
    ----------
    times: (n) s, increasing.
    values: (n, channels) SI, NaN where missing.
    sigma: (channels) standard deviation of the noise, SI.

    Returns
    -------
    (n, channels) true on an edge.
    """
    found = np.zeros(values.shape, dtype=bool)
    if times.size < 3:
        return found
    spacing = np.diff(times)
    even = spacing <= _GAP * float(np.median(spacing))
    bend = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
    sharp = (bend > THRESHOLD * _SECOND * sigma) & (even[1:] & even[:-1])[:, None]
    for shift in range(3):
        found[shift : shift + sharp.shape[0]] |= sharp
    return np.asarray(found & (found.mean(axis=0) <= _MOST))
