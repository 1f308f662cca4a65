"""Noise of one channel from its records: short windows, converter steps, then long windows if possible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.converter import noise_before, window_share
from rigctl.noise.pooling import Pooled, pool
from rigctl.noise.record import NoiseRecord
from rigctl.noise.windows import TREND_ORDER, Cell, WindowGroup, contrasts, cut_windows

#: largest number of consecutive windows that are joined: longer windows determine slow noise better
_LONGEST_JOIN = 4
#: noise larger than this many steps is not affected by them
_FINE = 0.6
#: tolerance factor of the variance referred to all levels if the noise is slow
_COARSE_TOLERANCE = 1.3
#: a window in which a converter leaves a smaller share of the noise than this is not used
_SWALLOWED = 0.2


@dataclass(frozen=True)
class ChannelData:
    """One channel of all records, the step of its converter (SI, 0 for none), and the order of its trends."""

    records: Sequence[NoiseRecord]
    ok: Sequence[NDArray[np.bool_]]
    channel: int
    spacing: float
    step: float
    order: int = TREND_ORDER


def learn_noise(data: ChannelData) -> Pooled | None:
    """The noise of one channel from windows of its records; None if they do not determine it.

    First from short windows; then, where several consecutive ones show noise alone, from long ones, which
    determine slow noise better. If a converter's steps are coarse, the variance of each window is referred to
    that over all levels (`window_share`), because a rod that rests in the middle of a step looks quieter than
    it is, and the sigma returned is ``√(σ₀² + Δ²/12)``.
    """
    # 1. Short windows under a low-order trend: which of them show noise alone?
    groups, cells = cut_windows(data.records, data.ok, data.channel, data.spacing, order=data.order)
    pooled = pool(groups, contrasts(groups), len(cells))
    if pooled is None:
        return None
    # 2. Coarse converter: whether a window looks quiet depends on where its level lies between two steps. Its
    #    variance is referred to that over all levels, twice, as σ₀ and the selection depend on each other.
    before = noise_before(data.step, pooled.fit.sigma)
    coarse = 0.0 < before < _FINE * data.step or pooled.fit.sigma**2 < data.step**2 / 12.0
    for _ in range(2 if coarse else 0):
        refined = _pool(groups, len(cells), data.step, before, pooled)
        if refined is None:
            break
        pooled = refined
        before = float(np.sqrt(max(0.0, pooled.fit.sigma**2 - data.step**2 / 12.0)))
    # 3. Longer windows, where neighbouring ones were quiet: noise that is slower than 40 samples looks like
    #    trend.
    step = data.step if coarse else 0.0
    return _over_long_windows(data, cells, pooled, step, before)


def _over_long_windows(
    data: ChannelData, cells: Sequence[Cell], pooled: Pooled, step: float, before: float
) -> Pooled:
    joined = _runs([cell for cell, used in zip(cells, pooled.used.tolist(), strict=True) if used])
    while joined:
        groups, longer = cut_windows(
            data.records, data.ok, data.channel, data.spacing, joined, order=data.order
        )
        refined = _pool(groups, len(longer), step, before, pooled)
        if refined is None:
            return pooled
        lost = {cell for cell, used in zip(longer, refined.used.tolist(), strict=True) if not used}
        if not lost & joined.keys():
            return refined
        joined = {cell: count for cell, count in joined.items() if cell not in lost}
    return pooled


def _pool(
    groups: Sequence[WindowGroup], cells: int, step: float, before: float, start: Pooled
) -> Pooled | None:
    referred = [_referred(group, step, before) for group in groups] if step else list(groups)
    referred = [group for group in referred if group.rows.size]
    return pool(
        referred, contrasts(referred), cells, start=start.fit, tolerance=_COARSE_TOLERANCE if step else 1.0
    )


def _referred(group: WindowGroup, step: float, before: float) -> WindowGroup:
    """The windows with the variance they would have over all levels, without those that show too little
    noise."""
    share = window_share(group.levels, step, before)
    trusted = group.only(share > _SWALLOWED)
    return replace(trusted, rows=trusted.rows / np.sqrt(share[share > _SWALLOWED])[:, None])


def _runs(used: Sequence[Cell]) -> dict[Cell, int]:
    """Cells that start a run of used cells (towards the front of their phase), and the length of the run."""
    remaining = set(used)
    runs = {}
    for phase, nth in sorted(used):
        if (phase, nth) not in remaining:
            continue
        length = 1
        while length < _LONGEST_JOIN and (phase, nth + length) in remaining:
            length += 1
        remaining -= {(phase, nth + i) for i in range(length)}
        if length > 1:
            runs[phase, nth] = length
    return runs
