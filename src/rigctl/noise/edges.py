"""Edges at a switch that the sampling does not resolve: readings dominated by timing error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: a second difference larger than this many of its own standard deviations is not noise
THRESHOLD = 4.0
#: standard deviation of a second difference of white noise, in units of that of the noise
_SECOND = float(np.sqrt(6.0))
#: number of samples on either side of a switch in which an edge may start
REACH = 2
#: number of second differences considered from the first significant one on
_FOLLOWED = 3
#: an edge is unresolved if more than this share of the slope change is reversed two samples later, as for a
#: first-order response with a time constant of less than two samples
_RETURNS = 0.6
#: a channel with such edges in more than this share of a record has them as part of its signal
_MOST = 0.25
#: larger intervals, relative to the usual one, are gaps
_GAP = 1.5


def find_edges(
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    sigma: NDArray[np.float64],
    switches: NDArray[np.float64],
    half_widths: NDArray[np.float64] | None = None,
) -> NDArray[np.bool_]:
    """Mask of the samples on an edge, at a switch, that is shorter than the sampling interval.

    Where an input is switched, a signal may pass through its edge between two samples: the pressure in a
    chamber whose valve opens rings at hundreds of hertz for some samples. Such a reading depends on its exact
    time within the interval and on every detail of the edge; it weighs hundreds of sigmas, and a fit has a
    minimum for every cycle. A slower signal also changes its slope at a switch, by far more than its noise,
    but keeps the new slope: its readings are as good as any.

    With ``d_i = y_(i+1) − 2y_i + y_(i−1)``: of the first d beyond ``THRESHOLD·√6·σ`` within `REACH` samples
    of a switch and the two after it, those of its sign are summed to U, and those of the other sign to D. The
    edge is not resolved if ``D > 0.6·U``: the change of slope has disappeared, or reversed, two samples
    later. Then the three samples of each of these second differences, and of those that follow without a
    break, are on the edge, except readings before the switch. If this holds for a quarter of the record, none
    are: a channel that does so everywhere does so as its signal.

    Parameters
    ----------
    times: (n) s, increasing.
    values: (n, channels) SI, NaN where missing.
    sigma: (channels) or (n, channels) standard deviation of the noise, SI.
    switches: times at which an input was switched, s.
    half_widths: uncertainty of each of these times, s; 0 by default.

    Returns
    -------
    (n, channels) True on an edge.
    """
    mask = np.zeros(values.shape, dtype=bool)
    if times.size < 3 or not switches.size:
        return mask
    half = np.zeros(switches.size) if half_widths is None else half_widths
    spacing = np.diff(times)
    usual = float(np.median(spacing))
    even = spacing <= _GAP * usual
    bend = values[2:] - 2.0 * values[1:-1] + values[:-2]
    scale = np.broadcast_to(sigma, values.shape)[1:-1]
    sharp = (np.abs(bend) > THRESHOLD * _SECOND * scale) & (even[1:] & even[:-1])[:, None]
    bend = np.where(sharp, bend, 0.0)
    # `bend[i]` is the second difference at sample i + 1. The window of each switch holds its uncertainty, and
    # `REACH` samples on either side; an edge starts at the first significant second difference in it.
    first = np.searchsorted(times[1:-1], switches - half - REACH * usual)
    last = np.searchsorted(times[1:-1], switches + half + (REACH + 0.5) * usual)
    before = np.searchsorted(times, switches - half - 1e-6 * usual).tolist()
    begins, ends = _next(sharp)[first], _next(~sharp)
    # +1 where a stretch begins, −1 after it
    marks = np.zeros((times.size + 1, values.shape[1]), dtype=np.int64)
    for switch, channel in np.argwhere(begins < last[:, None]).tolist():
        begin = int(begins[switch, channel])
        followed = begin + _FOLLOWED
        if not _turns_back(bend[begin:followed, channel]):
            continue
        at = [(k, k + 1) for k in range(begin, min(followed, len(sharp))) if sharp[k, channel]]
        for start, end in (*at, (followed, int(ends[min(followed, len(sharp)), channel]))):
            if start < end and before[switch] < end + 2:
                marks[max(start, before[switch]), channel] += 1
                marks[end + 2, channel] -= 1
    mask = np.cumsum(marks[:-1], axis=0) > 0
    return np.asarray(mask & (mask.mean(axis=0) <= _MOST))


def _next(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(n + 1, channels) the index of the next true flag from each place on; n where none follows.

    Known in advance: where nearly all are true, following each switch to the end of its edge would take a
    time proportional to the square of the record's length.
    """
    count = len(flags)
    places = np.where(flags, np.arange(count)[:, None], count)
    places = np.concatenate([places, np.full((1, flags.shape[1]), count)])
    return np.asarray(np.minimum.accumulate(places[::-1], axis=0)[::-1])


def _turns_back(bend: NDArray[np.float64]) -> bool:
    """Whether the change of slope of the first second difference is reversed by the following ones."""
    along = bend * np.sign(bend[0])
    forward, undone = float(np.maximum(along, 0.0).sum()), float(np.maximum(-along, 0.0).sum())
    return undone > _RETURNS * forward
