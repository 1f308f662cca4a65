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
#: the same where a model has taken the bench's own peaks off
_GUARD_OFF_MODEL = 3
#: the running median spans this many samples to either side: more than half of it outlasts the longest spike
_HALF = LONGEST_SPIKE + 1
#: the scale around a sample is taken from this many samples to either side, and weighs so much
_NEAR = 6
_NEAR_WEIGHT = 0.4
#: and, where noise grows with what is measured, from so many, which see enough of it to weigh in full
_WIDE = 25
#: samples on either side that a line takes
_LEAST_SIDE = 3
#: a spike is off the lines through its neighbours by this share of the threshold at least
_OFF_LINE = 0.4
#: one spike in so many readings, and they are the logger's habit: none in a thousand of normal noise
_COMMON = 200
#: a rate beside switches that is not this many times the rate elsewhere is the same one
_ALIKE = 2.0
#: samples worked on at a time
_CHUNK = 65536
#: a deviation of fewer converter steps than this is the converter's
_CONVERTER_STEPS = 2.7
#: standard deviation of a normal distribution cut off at ±3
_CUT_NORMAL = 0.98658


def find_spikes(
    times: NDArray[np.float64], values: NDArray[np.float64], phase: NDArray[np.intp] | None = None
) -> NDArray[np.bool_]:
    """Which samples are spikes.

    A sample is a spike when (1) it stands further than `THRESHOLD` robust standard deviations from the
    running median of its nine neighbours, taken as they are and along their slope (Hampel's filter, which
    follows steps and ramps), on the scale of the record or of its surroundings if larger; (2) at most
    `LONGEST_SPIKE` neighbours do so together; (3) it is off the lines through the samples on either side, and
    these meet within half its height. A step, a ramp, ringing and a converter's toggling are therefore no
    spikes.

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
    guarded = _after_switches(phase) if phase is not None else np.zeros(times.size, bool)
    (found,) = _departures(values, (False,))
    return np.asarray(found & ~guarded[:, None])


def _departures(
    values: NDArray[np.float64], local: Sequence[bool], off_model: bool = False
) -> list[NDArray[np.bool_]]:
    """Samples that leave the signal and come back, whatever is switched there, on each of the scales."""
    found = [np.zeros(values.shape, bool) for _ in local]
    for channel in range(values.shape[1]):
        finite = np.flatnonzero(np.isfinite(values[:, channel]))
        if finite.size > 2 * _HALF + 1:
            spikes = _spikes(values[finite, channel], local, off_model)
            for mask, spiky in zip(found, spikes, strict=True):
                mask[finite, channel] = spiky
    return found


def find_spikes_in_records(
    records: Sequence[NoiseRecord], *, local: bool = False, off_model: bool = False
) -> list[NDArray[np.bool_]]:
    """As `find_spikes_on_scales`, on one of them."""
    (found,) = find_spikes_on_scales(records, (local,), off_model=off_model)
    return found


def find_spikes_on_scales(
    records: Sequence[NoiseRecord], local: Sequence[bool], *, off_model: bool = False
) -> list[list[NDArray[np.bool_]]]:
    """`find_spikes` of every record, less what happens in most of them at the same sample of the same phase.

    A departure that comes back in more than half of at least four records belongs to the bench, not to the
    converter. The first and the last sample of a record are not excused by that. Where spikes are common (one
    reading in `_COMMON`), they do not keep away from switches: those right after a switch are taken out too,
    unless they are more frequent there than elsewhere, and thus the bench's.

    Parameters
    ----------
    local: of each scale whether it is that of the surroundings, for noise that is wider in some places than
        in others.
    off_model: the values are what a model leaves: fewer samples after a switch are left alone, and one that
        stands out beside an end of the record is a spike as well, as no signal can end there.
    """
    departures = [_departures(record.values, local, off_model) for record in records]
    return [
        _less_what_comes_back(
            records, _guarded_as_needed(records, [found[k] for found in departures], off_model)
        )
        for k in range(len(local))
    ]


def _less_what_comes_back(
    records: Sequence[NoiseRecord], masks: list[NDArray[np.bool_]]
) -> list[NDArray[np.bool_]]:
    """The masks less what is marked in most records at the same place."""
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
    elsewhere = _rate([mask & ~guard for mask, guard in zip(departures, guards, strict=True)], guards, False)
    beside = _rate([mask & guard for mask, guard in zip(departures, guards, strict=True)], guards, True)
    common = (elsewhere > 1.0 / _COMMON) & (beside < _ALIKE * elsewhere)
    return [mask & (~guard | common) for mask, guard in zip(departures, guards, strict=True)]


def _rate(
    masks: Sequence[NDArray[np.bool_]], guards: Sequence[NDArray[np.bool_]], inside: bool
) -> NDArray[np.float64]:
    """(channels) the share of the samples beside switches, or of all others, that are marked."""
    marked = sum(mask.sum(axis=0) for mask in masks)
    samples = sum(int((guard == inside).sum()) for guard in guards)
    return np.asarray(marked, float) / max(samples, 1)


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


def _after_switches(phase: NDArray[np.intp], guard: int = SWITCH_GUARD) -> NDArray[np.bool_]:
    guarded = np.zeros(phase.size, bool)
    for switch in (np.flatnonzero(np.diff(phase)) + 1).tolist():
        guarded[switch - 1 : switch + guard] = True
    return guarded


def _spikes(x: NDArray[np.float64], local: Sequence[bool], off_model: bool) -> list[NDArray[np.bool_]]:
    from scipy.ndimage import median_filter

    along, away, level = _away(x)
    floor = max(1e-4 * float(np.ptp(level)), _CONVERTER_STEPS / THRESHOLD * _smallest_change(x))
    near = 1.4826 * np.asarray(median_filter(np.abs(away), size=2 * _NEAR + 1, mode="mirror"))
    usual = np.maximum(
        max(_clipped_scale(away), _clipped_scale(away[_flattest(level)]), floor), _NEAR_WEIGHT * near
    )
    height = np.minimum(np.abs(along), np.abs(away))
    found = []
    for of_surroundings in local:
        scale = usual
        if of_surroundings:
            wide = 1.4826 * np.asarray(median_filter(np.abs(away), size=2 * _WIDE + 1, mode="mirror"))
            scale = np.maximum(scale, wide)
        found.append(_returning(x, height, scale, off_model))
    return found


def _returning(
    x: NDArray[np.float64], height: NDArray[np.float64], scale: NDArray[np.float64], off_model: bool
) -> NDArray[np.bool_]:
    """The samples of the short departures, further than the threshold on a scale, that come back."""
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
    """Each sample less the median of its nine neighbours moved along their slope, less that left; and that.

    The slope is the median of the eight differences: it follows a ramp, but not a step nor a spike. Moved
    along it, the median on a ramp is not dragged by a spike close by. As it is, the median takes every bend
    of a rising or falling signal for what it is.
    """
    padded = np.concatenate([_before(x)[::-1], x, _before(x[::-1])])
    level, still = np.empty(x.size), np.empty(x.size)
    width = 2 * _HALF + 1
    for begin in range(0, x.size, _CHUNK):
        part = padded[begin : begin + _CHUNK + width - 1]
        around = np.lib.stride_tricks.sliding_window_view(part, width)
        slope = np.median(np.diff(around, axis=1), axis=1)
        along = around - slope[:, None] * np.arange(-_HALF, _HALF + 1.0)
        level[begin : begin + _CHUNK] = np.median(along, axis=1)
        still[begin : begin + _CHUNK] = np.median(around, axis=1)
    return x - level, x - still, still


def _before(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """What would have stood before x, nearest first: a robust line through its samples but the first."""
    part = x[1 : 2 + 3 * _HALF]
    at = np.arange(1.0, part.size + 1.0)
    half = part.size // 2
    slope = float(np.median((part[-half:] - part[:half]) / (part.size - half)))
    level = float(np.median(part - slope * at))
    return level + slope * np.arange(-1.0, -1.0 - _HALF, -1.0)


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
        before, scale = scale, float(np.sqrt(np.mean(kept**2))) / _CUT_NORMAL
        if scale == before:
            break
    return scale


def _runs(far: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open ranges of consecutive true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _leaves_and_returns(
    x: NDArray[np.float64], far: NDArray[np.bool_], first: int, last: int, scale: float
) -> bool:
    """Whether a departure is off the lines through the samples on either side, and these lines meet.

    The crest of an oscillation lies where the lines before and after it lead. At an end of the record there
    is one side only, and none to judge by.
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
    """The least-squares line through a few samples, at a place."""
    centred = samples - samples.mean()
    slope = float(centred @ x) / float(centred @ centred)
    return float(x.mean()) + slope * (where - float(samples.mean()))
