"""Spikes: readings of a few samples that leave the signal and return, found without a model.

In: records, or the residuals of a model. Out: a mask for each. A spike weighs as much in a sum of squares as
thousands of readings, and a step, a ramp, ringing or a converter's steps must not be taken for one: each
condition below excludes one of these.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.record import NoiseRecord

#: a longer departure counts as signal
LONGEST_SPIKE = 3
#: in robust standard deviations; one in 150 000 samples of normal noise lies further out
THRESHOLD = 4.5
#: number of samples after a switch in which a narrow peak may be real
SWITCH_GUARD = 10
#: that number if a model has removed the bench's own peaks
_GUARD_OFF_MODEL = 3
#: samples on either side in the running median, of which more than half outlast the longest spike
_HALF = LONGEST_SPIKE + 1
#: number of samples on either side that determine the local scale, and their weight
_NEAR = 6
_NEAR_WEIGHT = 0.4
#: the same for noise that depends on the signal: enough samples for full weight
_WIDE = 25
#: least number of samples on either side for a line
_LEAST_SIDE = 3
#: least deviation of a spike from the lines through its neighbours, as a share of the threshold
_OFF_LINE = 0.4
#: spikes are common if there is at least one in this many readings; normal noise has fewer than one in a
#: thousand
_COMMON = 200
#: a rate near switches that is less than this many times the rate elsewhere counts as the same
_ALIKE = 2.0
#: number of samples processed at a time
_CHUNK = 65536
#: a deviation of fewer converter steps than this is attributed to the converter
_CONVERTER_STEPS = 2.7
#: standard deviation of a normal distribution truncated at ±3
_CUT_NORMAL = 0.98658


def find_spikes(
    times: NDArray[np.float64], values: NDArray[np.float64], phase: NDArray[np.intp] | None = None
) -> NDArray[np.bool_]:
    """Mask of the samples that are spikes.

    A sample is a spike if (1) it deviates by more than `THRESHOLD` robust standard deviations from the
    running median of its nine neighbours, both unchanged and shifted along their slope (Hampel's filter,
    which follows steps and ramps), on the scale of the record or of its surroundings if larger; (2) at most
    `LONGEST_SPIKE` neighbours do so together; (3) it deviates from the lines through the samples on either
    side, and these meet within half its height. A step, a ramp, ringing and a toggling converter are
    therefore not spikes.

    A real peak of one sample right after a switch (the pressure in a chamber when the valve opens) cannot be
    distinguished from a spike in one record: with `phase` given, the first `SWITCH_GUARD` samples after every
    switch are left alone.

    Parameters
    ----------
    times: (n) s, increasing.
    values: (n, channels), NaN if missing.
    phase: (n) index of the period of constant commands of each sample.

    Returns
    -------
    (n, channels) True if a sample is a spike; False if it is missing.

    Source: Pearson, *Mining Imperfect Data* (2005), ch. 3; Hampel, J. Am. Stat. Assoc. 69 (1974) 383.
    """
    guarded = _after_switches(phase) if phase is not None else np.zeros(times.size, bool)
    (mask,) = _departures(values, (False,))
    return np.asarray(mask & ~guarded[:, None])


def _departures(
    values: NDArray[np.float64], local: Sequence[bool], off_model: bool = False
) -> list[NDArray[np.bool_]]:
    """Samples that leave the signal and return, regardless of switches, on each of the scales."""
    masks = [np.zeros(values.shape, bool) for _ in local]
    for channel in range(values.shape[1]):
        finite = np.flatnonzero(np.isfinite(values[:, channel]))
        if finite.size > 2 * _HALF + 1:
            spikes = _spikes(values[finite, channel], local, off_model)
            for mask, spiky in zip(masks, spikes, strict=True):
                mask[finite, channel] = spiky
    return masks


def find_spikes_in_records(
    records: Sequence[NoiseRecord], *, local: bool = False, off_model: bool = False
) -> list[NDArray[np.bool_]]:
    """As `find_spikes_on_scales`, for a single scale."""
    (masks,) = find_spikes_on_scales(records, (local,), off_model=off_model)
    return masks


def find_spikes_on_scales(
    records: Sequence[NoiseRecord], local: Sequence[bool], *, off_model: bool = False
) -> list[list[NDArray[np.bool_]]]:
    """`find_spikes` for every record, except what most of them share at the same sample of the same phase.

    A departure that returns in more than half of at least four records belongs to the bench, not to the
    converter. This does not apply to the first and the last sample of a record. If spikes are common (one
    reading in `_COMMON`), they also occur near switches: those right after a switch are removed too, unless
    they are more frequent there than elsewhere, and thus the bench's.

    Parameters
    ----------
    local: for each scale whether it is that of the surroundings, for noise that varies along the record.
    off_model: the values are a model's residuals: fewer samples after a switch are left alone, and an outlier
        near an end of the record is a spike as well, as no signal can end there.
    """
    departures = [_departures(record.values, local, off_model) for record in records]
    return [
        _without_recurring(
            records, _guarded_as_needed(records, [masks[k] for masks in departures], off_model)
        )
        for k in range(len(local))
    ]


def _without_recurring(
    records: Sequence[NoiseRecord], masks: list[NDArray[np.bool_]]
) -> list[NDArray[np.bool_]]:
    """The masks without what is marked at the same place in most records."""
    counts: dict[tuple[int, int, int], int] = {}
    indices = [_places(record, mask) for record, mask in zip(records, masks, strict=True)]
    for index in indices:
        for key, _ in index:
            counts[key] = counts.get(key, 0) + 1
    if len(records) < 4:
        return masks
    for mask, index in zip(masks, indices, strict=True):
        for key, (sample, channel) in index:
            if counts[key] > len(records) / 2 and 0 < sample < mask.shape[0] - 1:
                mask[sample, channel] = False
    return masks


def _guarded_as_needed(
    records: Sequence[NoiseRecord], departures: Sequence[NDArray[np.bool_]], off_model: bool
) -> list[NDArray[np.bool_]]:
    """The departures of each record, those after switches only in channels whose spikes come anywhere."""
    guard = _GUARD_OFF_MODEL if off_model else SWITCH_GUARD
    guards = [_after_switches(record.phase, guard)[:, None] for record in records]
    if not records:
        return []
    # Right after a switch a spike and a real peak look alike. Where spikes are common, and no more frequent
    # there than elsewhere, they are the logger's.
    elsewhere = _rate([mask & ~guard for mask, guard in zip(departures, guards, strict=True)], guards, False)
    beside = _rate([mask & guard for mask, guard in zip(departures, guards, strict=True)], guards, True)
    common = (elsewhere > 1.0 / _COMMON) & (beside < _ALIKE * elsewhere)
    return [mask & (~guard | common) for mask, guard in zip(departures, guards, strict=True)]


def _rate(
    masks: Sequence[NDArray[np.bool_]], guards: Sequence[NDArray[np.bool_]], inside: bool
) -> NDArray[np.float64]:
    """(channels) the share of marked samples near switches, or among all others."""
    marked = sum(mask.sum(axis=0) for mask in masks)
    samples = sum(int((guard == inside).sum()) for guard in guards)
    return np.asarray(marked, float) / max(samples, 1)


def _places(
    record: NoiseRecord, mask: NDArray[np.bool_]
) -> list[tuple[tuple[int, int, int], tuple[int, int]]]:
    """Each spike's location in its phase, (phase, samples after its start, channel), and in the record."""
    starts: dict[int, int] = {}
    for sample, phase in enumerate(record.phase.tolist()):
        starts.setdefault(phase, sample)
    return [
        ((phase, sample - starts[phase], channel), (sample, channel))
        for sample, channel in np.argwhere(mask).tolist()
        for phase in [int(record.phase[sample])]
    ]


def _after_switches(phase: NDArray[np.intp], guard: int = SWITCH_GUARD) -> NDArray[np.bool_]:
    guarded = np.zeros(phase.size, bool)
    for switch in (np.flatnonzero(np.diff(phase)) + 1).tolist():
        guarded[switch - 1 : switch + guard] = True
    return guarded


def _spikes(x: NDArray[np.float64], local: Sequence[bool], off_model: bool) -> list[NDArray[np.bool_]]:
    from scipy.ndimage import median_filter

    # Two deviations from the running median, along the slope and without it: a spike is far in both, a ramp
    # or a crest in one only.
    along, away, level = _away(x)
    floor = max(1e-4 * float(np.ptp(level)), _CONVERTER_STEPS / THRESHOLD * _smallest_change(x))
    near = 1.4826 * np.asarray(median_filter(np.abs(away), size=2 * _NEAR + 1, mode="mirror"))
    # The scale is the largest of several, as too small a one marks signal as spikes: clipped over the record,
    # over its flattest quarter, and around the sample; never below a few steps of the converter.
    usual = np.maximum(
        max(_clipped_scale(away), _clipped_scale(away[_flattest(level)]), floor), _NEAR_WEIGHT * near
    )
    height = np.minimum(np.abs(along), np.abs(away))
    masks = []
    for of_surroundings in local:
        scale = usual
        if of_surroundings:
            wide = 1.4826 * np.asarray(median_filter(np.abs(away), size=2 * _WIDE + 1, mode="mirror"))
            scale = np.maximum(scale, wide)
        masks.append(_returning(x, height, scale, off_model))
    return masks


def _returning(
    x: NDArray[np.float64], height: NDArray[np.float64], scale: NDArray[np.float64], off_model: bool
) -> NDArray[np.bool_]:
    """The samples of short departures beyond the threshold, on a scale, from which the signal returns."""
    far = height > THRESHOLD * scale
    spikes = np.zeros(x.size, bool)
    for first, last in _runs(far):
        if last - first > LONGEST_SPIKE:
            continue
        beside_end = off_model and min(first, x.size - last) < _LEAST_SIDE
        if beside_end or _leaves_and_returns(x, far, first, last, float(scale[first])):
            spikes[first:last] = True
    return spikes


def _away(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Each sample less the shifted median of its nine neighbours, less the unshifted one, and that median.

    The slope is the median of the eight differences: it follows a ramp, but neither a step nor a spike.
    Shifted along it, the median on a ramp is not distorted by a nearby spike. Unshifted, the median follows
    every curvature of a rising or falling signal.
    """
    padded = np.concatenate([_before(x)[::-1], x, _before(x[::-1])])
    level, still = np.empty(x.size), np.empty(x.size)
    width = 2 * _HALF + 1
    for begin in range(0, x.size, _CHUNK):
        part = padded[begin : begin + _CHUNK + width - 1]
        around = np.lib.stride_tricks.sliding_window_view(part, width)
        slope = _medians(np.diff(around, axis=1))
        along = around - slope[:, None] * np.arange(-_HALF, _HALF + 1.0)
        level[begin : begin + _CHUNK] = _medians(along)
        still[begin : begin + _CHUNK] = _medians(around)
    return x - level, x - still, still


def _medians(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """The median of each row of finite numbers; unlike NumPy's, without the cost of a check for others."""
    half = rows.shape[1] // 2
    if rows.shape[1] % 2:
        return np.asarray(np.partition(rows, half, axis=1)[:, half])
    middle = np.partition(rows, (half - 1, half), axis=1)
    return np.asarray((middle[:, half - 1] + middle[:, half]) / 2.0)


def _median(values: NDArray[np.float64]) -> float:
    return float(_medians(values[None, :])[0])


def _quantile(values: NDArray[np.float64], share: float) -> float:
    """The quantile of finite numbers, interpolated between the two nearest, also without that check."""
    at = share * (values.size - 1)
    below = int(at)
    above = min(below + 1, values.size - 1)
    ordered = np.partition(values, (below, above))
    low, high = float(ordered[below]), float(ordered[above])
    part = at - below
    return high - (high - low) * (1.0 - part) if part >= 0.5 else low + (high - low) * part


def _before(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Extrapolation to before x, nearest first: a robust line through its samples except the first."""
    part = x[1 : 2 + 3 * _HALF]
    at = np.arange(1.0, part.size + 1.0)
    half = part.size // 2
    slope = _median((part[-half:] - part[:half]) / (part.size - half))
    level = _median(part - slope * at)
    return level + slope * np.arange(-1.0, -1.0 - _HALF, -1.0)


def _smallest_change(x: NDArray[np.float64]) -> float:
    """The smallest difference between two occurring values: a converter's step, or nearly zero."""
    between = np.diff(np.unique(x))
    real = between[between > 1e-6 * float(np.ptp(x))]
    return float(real.min()) if real.size else 0.0


def _flattest(level: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The quarter of the samples at which the level changes least.

    On a ramp steeper than the noise the running median is the sample itself and the deviation zero: a record
    that is mostly ramp would give too small a scale.
    """
    change = np.abs(np.roll(level, -_HALF) - np.roll(level, _HALF))
    change[:_HALF] = change[_HALF]
    change[-_HALF:] = change[-_HALF - 1]
    return np.asarray(change <= _quantile(change, 0.25))


def _clipped_scale(away: NDArray[np.float64]) -> float:
    """Standard deviation after repeatedly removing everything beyond three of them."""
    size = np.abs(away)
    scale = max(1.4826 * _median(size), _quantile(size, 0.68))
    for _ in range(10):
        core = away[size <= 3.0 * scale]
        previous, scale = scale, float(np.sqrt(np.mean(core**2))) / _CUT_NORMAL
        if scale == previous:
            break
    return scale


def _runs(far: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open ranges of consecutive true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _leaves_and_returns(
    x: NDArray[np.float64], far: NDArray[np.bool_], first: int, last: int, scale: float
) -> bool:
    """Whether a departure deviates from the lines through the samples on either side, and these lines meet.

    The crest of an oscillation lies near the intersection of the lines before and after it. At an end of the
    record only one side exists: a departure with too few samples on one side counts only at the very end.
    """
    before = np.flatnonzero(~far[max(0, first - 8) : first])[-4:] + max(0, first - 8)
    after = np.flatnonzero(~far[last : last + 8])[:4] + last
    if min(before.size, after.size) < _LEAST_SIDE:
        return first == 0 or last == x.size
    middle = (first + last - 1) / 2.0
    centre = float(np.median(x[first:last]))
    off = np.array([centre - _at(side, x[side], middle) for side in (before, after)])
    level = abs(float(np.median(x[before]) - np.median(x[after])))
    height = float(np.max(np.abs(off)))
    returns = min(level, float(abs(off[0] - off[1]))) < max(height / 2.0, THRESHOLD * scale)
    return (
        returns and bool(off[0] * off[1] > 0.0) and float(np.min(np.abs(off))) > _OFF_LINE * THRESHOLD * scale
    )


def _at(samples: NDArray[np.intp], x: NDArray[np.float64], where: float) -> float:
    """The least-squares line through a few samples, evaluated at a point."""
    centred = samples - samples.mean()
    slope = float(centred @ x) / float(centred @ centred)
    return float(x.mean()) + slope * (where - float(samples.mean()))
