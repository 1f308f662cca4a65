"""Spikes: readings of a few samples that leave the signal and come back, found without a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.record import NoiseRecord

#: a longer departure is taken for a signal
LONGEST_SPIKE = 3
#: in robust standard deviations; one in 150 000 samples of normal noise lies further out
THRESHOLD = 4.5
#: samples after a switch in which a narrow peak may be real
SWITCH_GUARD = 10
#: the running median spans this many samples to either side: more than half of it outlasts the longest spike
_HALF = LONGEST_SPIKE + 1
#: a deviation of fewer converter steps than this is the converter's
_CONVERTER_STEPS = 2.7
#: standard deviation of a normal distribution cut off at ±3
_CUT_NORMAL = 0.98658


def find_spikes(
    times: NDArray[np.float64], values: NDArray[np.float64], phase: NDArray[np.intp] | None = None
) -> NDArray[np.bool_]:
    """Which samples are spikes.

    A sample is a spike when (1) it stands further than `THRESHOLD` robust standard deviations from the
    running median of its nine neighbours, which follows steps and ramps exactly (Hampel's filter), on the
    scale of the record or of its flattest quarter, whichever is larger; (2) at most `LONGEST_SPIKE`
    neighbours do so together; (3) the signal goes on afterwards where it was before: lines through the
    samples on either side meet within half its height. A step, a ramp and a converter's toggling are
    therefore no spikes.

    A real peak of one sample right after a switch (a chamber's pressure when the valve opens) cannot be told
    from a spike in one record: hand in `phase`, and the first `SWITCH_GUARD` samples after every switch are
    left alone.

    Parameters
    ----------
    times: (n) s, increasing.
    values: (n, channels), NaN where missing.
    phase: (n) the number of the stretch of constant commands each sample lies in.

    Returns
    -------
    (n, channels) true where a sample is a spike; never where it is missing.

    Source: Pearson, *Mining Imperfect Data* (2005), ch. 3; Hampel, J. Am. Stat. Assoc. 69 (1974) 383.
    """
    found = np.zeros(values.shape, bool)
    guarded = _after_switches(phase) if phase is not None else np.zeros(times.size, bool)
    for channel in range(values.shape[1]):
        finite = np.flatnonzero(np.isfinite(values[:, channel]))
        if finite.size > 2 * _HALF + 1:
            found[finite, channel] = _spikes(values[finite, channel])
    return np.asarray(found & ~guarded[:, None])


def find_spikes_in_records(records: Sequence[NoiseRecord]) -> list[NDArray[np.bool_]]:
    """`find_spikes` of every record, less what happens in most of them at the same sample of the same phase.

    A departure that comes back in more than half of at least four records belongs to the bench, not to the
    converter. The first and the last sample of a record are not excused by that.
    """
    masks = [find_spikes(record.times, record.values, record.phase) for record in records]
    counts: dict[tuple[int, int, int], int] = {}
    places = [_places(record, mask) for record, mask in zip(records, masks, strict=True)]
    for place in places:
        for key, _ in place:
            counts[key] = counts.get(key, 0) + 1
    if len(records) < 4:
        return masks
    for mask, place in zip(masks, places, strict=True):
        for key, (sample, channel) in place:
            if counts[key] > len(records) / 2 and 0 < sample < mask.shape[0] - 1:
                mask[sample, channel] = False
    return masks


def _places(
    record: NoiseRecord, mask: NDArray[np.bool_]
) -> list[tuple[tuple[int, int, int], tuple[int, int]]]:
    """Each spike's place in its phase, (phase, samples after its begin, channel), and in the record."""
    starts: dict[int, int] = {}
    for sample, phase in enumerate(record.phase.tolist()):
        starts.setdefault(phase, sample)
    return [
        ((phase, sample - starts[phase], channel), (sample, channel))
        for sample, channel in np.argwhere(mask).tolist()
        for phase in [int(record.phase[sample])]
    ]


def _after_switches(phase: NDArray[np.intp]) -> NDArray[np.bool_]:
    guarded = np.zeros(phase.size, bool)
    for switch in (np.flatnonzero(np.diff(phase)) + 1).tolist():
        guarded[switch - 1 : switch + SWITCH_GUARD] = True
    return guarded


def _spikes(x: NDArray[np.float64]) -> NDArray[np.bool_]:
    from scipy.ndimage import median_filter

    padded = np.concatenate([_before(x)[::-1], x, _before(x[::-1])])
    level = np.asarray(median_filter(padded, size=2 * _HALF + 1))[_HALF : _HALF + x.size]
    away = x - level
    span = float(np.ptp(level))
    floor = max(1e-4 * span, _CONVERTER_STEPS / THRESHOLD * _smallest_change(x))
    scale = max(_clipped_scale(away), _clipped_scale(away[_flattest(level)]), floor)
    far = np.abs(away) > THRESHOLD * scale
    spikes = np.zeros(x.size, bool)
    for first, last in _runs(far):
        if last - first <= LONGEST_SPIKE and _comes_back(x, far, first, last, scale):
            spikes[first:last] = True
    return spikes


def _before(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """What would have stood before x, nearest first: a robust line through its samples but the first."""
    near, further = float(np.median(x[1:5])), float(np.median(x[5:9]))
    slope = (further - near) / 4.0
    at = np.arange(-1.0, -1.0 - _HALF, -1.0)
    return near + slope * (at - 2.5)


def _smallest_change(x: NDArray[np.float64]) -> float:
    """The smallest difference between two values that occur: a converter's step, or next to nothing."""
    between = np.diff(np.unique(x))
    real = between[between > 1e-6 * float(np.ptp(x))]
    return float(real.min()) if real.size else 0.0


def _flattest(level: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The quarter of the samples where the level changes least.

    On a ramp steeper than the noise the running median is the sample itself and the deviation zero: a record
    that is mostly ramp would show too small a scale.
    """
    change = np.abs(np.roll(level, -_HALF) - np.roll(level, _HALF))
    change[:_HALF] = change[_HALF]
    change[-_HALF:] = change[-_HALF - 1]
    return np.asarray(change <= np.quantile(change, 0.25))


def _clipped_scale(away: NDArray[np.float64]) -> float:
    """Standard deviation of what is left when everything beyond three of them is left out, repeatedly."""
    size = np.abs(away)
    scale = max(1.4826 * float(np.median(size)), float(np.quantile(size, 0.68)))
    for _ in range(10):
        kept = away[size <= 3.0 * scale]
        scale = float(np.sqrt(np.mean(kept**2))) / _CUT_NORMAL
    return scale


def _runs(far: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open ranges of consecutive true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _comes_back(x: NDArray[np.float64], far: NDArray[np.bool_], first: int, last: int, scale: float) -> bool:
    """Whether the signal after a departure continues the one before it; at an end of the record: always."""
    before = np.flatnonzero(~far[max(0, first - 8) : first])[-4:] + max(0, first - 8)
    after = np.flatnonzero(~far[last : last + 8])[:4] + last
    if before.size < 3 or after.size < 3:
        return first == 0 or last == x.size
    middle = (first + last - 1) / 2.0
    level = abs(float(np.median(x[before]) - np.median(x[after])))
    line = abs(_at(before, x[before], middle) - _at(after, x[after], middle))
    height = abs(float(np.median(x[first:last])) - _at(before, x[before], middle))
    return min(level, line) < max(height / 2.0, THRESHOLD * scale)


def _at(samples: NDArray[np.intp], x: NDArray[np.float64], where: float) -> float:
    """The least-squares line through a few samples, at a place."""
    centred = samples - samples.mean()
    slope = float(centred @ x) / float(centred @ centred)
    return float(x.mean()) + slope * (where - float(samples.mean()))
