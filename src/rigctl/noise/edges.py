"""Edges beside a switch that the sampling does not resolve: readings dominated by timing error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: a second difference of so many of its own standard deviations is more than noise
THRESHOLD = 4.0
#: standard deviation of a second difference of white noise, in those of the noise
_SECOND = float(np.sqrt(6.0))
#: samples on either side of a switch in which an edge begins
REACH = 2
#: bends that are looked at from the first one on
_FOLLOWED = 3
#: of the change of slope at a switch so much is gone again two samples later where the sampling is too slow:
#: a first-order response with a time constant of less than two samples
_RETURNS = 0.6
#: a channel that bends so in more than this share of a record does so everywhere: that is its signal
_MOST = 0.25
#: spacings that differ by more than this from the usual one are gaps
_GAP = 1.5


def find_edges(
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    sigma: NDArray[np.float64],
    switches: NDArray[np.float64],
    half_widths: NDArray[np.float64] | None = None,
) -> NDArray[np.bool_]:
    """Which samples lie on an edge beside a switch that is shorter than the sampling.

    Where an input is switched, a signal may run through its edge between two samples: the pressure of a
    chamber when its valve opens rings at hundreds of hertz for some samples. Such a reading hangs on when
    within the interval it was taken, and on every detail of how the edge runs; it weighs hundreds of sigmas,
    and a fit has a minimum for every beat. A slower signal bends at a switch as well, by far more than its
    noise, and goes on with its new slope: its readings are as good as any.

    With ``d_i = y_(i+1) − 2y_i + y_(i−1)``, of the first bend beyond ``THRESHOLD·√6·σ`` within `REACH`
    samples of a switch and the two after it, those of its sign are summed, U, and those of the other, D. The
    edge is not resolved where ``D > 0.6·U``: the slope that the switch made is gone again, or has turned
    round, two samples later. Then the three samples of each of these bends, and of those that follow them
    without a break, are on the edge; but for what was read before the switch. None of them where that is true
    of a quarter of the record: a channel that bends so everywhere does so as its signal.

    Parameters
    ----------
    times: (n) s, increasing.
    values: (n, channels) SI, NaN where missing.
    sigma: (channels) or (n, channels) standard deviation of the noise, SI.
    switches: times at which an input was switched, s.
    half_widths: by how much each of these may be off, s; 0 where not given.

    Returns
    -------
    (n, channels) true on an edge.
    """
    found = np.zeros(values.shape, dtype=bool)
    if times.size < 3 or not switches.size:
        return found
    half = np.zeros(switches.size) if half_widths is None else half_widths
    spacing = np.diff(times)
    usual = float(np.median(spacing))
    even = spacing <= _GAP * usual
    bend = values[2:] - 2.0 * values[1:-1] + values[:-2]
    scale = np.broadcast_to(sigma, values.shape)[1:-1]
    sharp = (np.abs(bend) > THRESHOLD * _SECOND * scale) & (even[1:] & even[:-1])[:, None]
    bend = np.where(sharp, bend, 0.0)
    for switch, width in zip(switches.tolist(), half.tolist(), strict=True):
        # `bend[i]` is that at sample i + 1
        reach = [switch - width - REACH * usual, switch + width + (REACH + 0.5) * usual]
        first, last = np.searchsorted(times[1:-1], reach)
        before = int(np.searchsorted(times, switch - width - 1e-6 * usual))
        for channel in np.flatnonzero(sharp[first:last].any(axis=0)).tolist():
            begin = first + int(np.argmax(sharp[first:last, channel]))
            end = begin + _FOLLOWED
            if not _turns_back(bend[begin:end, channel]):
                continue
            while end < sharp.shape[0] and sharp[end, channel]:
                end += 1
            at = begin + np.flatnonzero(sharp[begin:end, channel])
            on = np.unique(at[:, None] + np.arange(3))
            found[on[on >= before], channel] = True
    return np.asarray(found & (found.mean(axis=0) <= _MOST))


def _turns_back(bend: NDArray[np.float64]) -> bool:
    """Whether the change of slope that the first bend makes is undone by those after it."""
    along = bend * np.sign(bend[0])
    made, undone = float(np.maximum(along, 0.0).sum()), float(np.maximum(-along, 0.0).sum())
    return undone > _RETURNS * made
