"""Whether a record keeps clear of every limit of the rig, and within the model's validity, for every
rival."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.design.rivals import Rival
from rigctl.design.virtual_records import Scene
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.record import MeasuredRecord
from rigctl.model.validity import departures
from rigctl.rig.limit import Limit
from rigctl.rig.rig import Rig

Floats = NDArray[np.float64]

#: relative tolerance of times
_ROUNDING = 1e-9
#: distance that a reading keeps from every limit, in standard deviations
CLEARANCE = 3.0


def clear_of_limits(
    rig: Rig, channels: Sequence[str], times: Floats, outputs: Floats, spread: Floats
) -> bool:
    """Whether readings (n, channels) with this standard deviation, SI, keep `CLEARANCE` from every limit."""
    room = CLEARANCE * spread
    return all(
        _clear(limit, times, outputs[:, index], room[:, index])
        for limit in rig.limits.values()
        for index in [channels.index(limit.channel) if limit.channel in channels else -1]
        if index >= 0 and limit.bound != "unchanged"
    ) and all(_possible(rig, name, outputs[:, k], room[:, k]) for k, name in enumerate(channels))


def _clear(limit: Limit, times: Floats, course: Floats, room: Floats) -> bool:
    if limit.of_rate:
        course, room = _rates(times, course, room, limit.over)
    upwards = limit.bound in ("above", "rate_above")
    nearest = limit.threshold - (course + room) if upwards else (course - room) - limit.threshold
    return bool(np.all(nearest > 0.0))


def _rates(times: Floats, course: Floats, room: Floats, over: float) -> tuple[Floats, Floats]:
    """Rates of change over a period, and the contribution of noise to them."""
    # at the latest sample that is at least so long ago
    before = np.searchsorted(times, times - over * (1.0 - _ROUNDING), side="right") - 1
    later = np.flatnonzero(before >= 0)
    if not later.size:
        return np.zeros(1), np.zeros(1)
    apart = times[later] - times[before[later]]
    change = (course[later] - course[before[later]]) / apart
    return change, np.hypot(room[later], room[before[later]]) / apart


def _possible(rig: Rig, name: str, course: Floats, room: Floats) -> bool:
    channel = rig.channels.get(name)
    if channel is None or channel.range is None:
        return True
    low, high = (float(end) for end in channel.range)
    return bool(np.all(course - room > low) and np.all(course + room < high))


def keeps_clear(rig: Rig, channels: Sequence[str], scene: Scene, covariances: Sequence[Floats]) -> bool:
    """Whether every rival keeps clear, with the uncertainty of its parameters added to the noise."""
    for predicted, covariance in zip(scene.predicted, covariances, strict=True):
        # Three standard deviations of everything that is uncertain: noise, the rival's parameters, settings
        # and zeros.
        spread = np.hypot(scene.sigma, predicted.spread(covariance))
        if not np.all(np.isfinite(predicted.outputs)):
            return False
        if not clear_of_limits(rig, channels, scene.record.times, predicted.outputs, spread):
            return False
    return True


def inside_validity(rivals: Sequence[Rival], records: Sequence[MeasuredRecord]) -> list[bool]:
    """For each record, whether it stays within the ranges over which every rival's laws were learned."""
    from rigctl.design.virtual_records import Outlines

    good = [True] * len(records)
    for rival in rivals:
        model = rival.fit.problem.model
        if not any(model.effect(name).valid for name in model.effects):
            continue
        for k, record in enumerate(records):
            problem = Outlines(rival, [record]).problem
            local = tuple(np.array([one.unknown.start for one in unknowns]) for unknowns in problem.local)
            result = FitResult(problem, (0,), None, rival.fit.values, local, (record.values,))
            good[k] = good[k] and not departures(result)
    return good
