"""How an error runs over the time of a record: where the model is above what was measured, where below."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.localise import variable_units
from rigctl.model.fit.fit import FitResult
from rigctl.units import parse_unit, show

Floats = NDArray[np.float64]

#: every phase is looked at in parts, finer after its beginning: what a switch starts fades out
_PARTS = (0.0, 1 / 27, 1 / 9, 1 / 3, 1.0)
#: a part counts when its mean is this many standard errors, and this share of the noise, away from 0
_SURE, _NOTABLE = 6.0, 0.25
#: a variable is named where the records' errors follow it at least so well
_FOLLOWS = 0.8
#: another one is named instead where they follow it better by this
_BETTER = 0.05
#: and only where the errors at its ends differ by this share of the largest
_CHANGES = 0.3
_MOST = 3


@dataclass(frozen=True)
class Stretch:
    """A stretch of time in which the records' mean error keeps its sign; SI.

    Attributes
    ----------
    channel: of which reading.
    start, end: s from the records' beginning.
    peak: the largest mean over the records of model less measured, of any part of it.
    weight: for ranking, squares over the noise's; a long stretch counts by the root of its length.
    by_record: (records) the mean of each in the part of the peak; NaN where a record has none.
    """

    channel: str
    start: float
    end: float
    peak: float
    weight: float
    by_record: Floats


def error_course(fit: FitResult, channel: str) -> tuple[Stretch, ...]:
    """The stretches that matter most, in the order of time; none where there is only noise."""
    column = fit.problem.measurements.outputs.index(channel)
    found: list[Stretch] = []
    gap = 1.5 * fit.problem.noise.spacing
    for part in _parts(fit, column) if _timed(fit) else ():
        last = found[-1] if found else None
        if last is not None and part.start - last.end < gap and part.peak * last.peak > 0.0:
            larger = part if abs(part.peak) > abs(last.peak) else last
            found[-1] = Stretch(
                channel, last.start, part.end, larger.peak, last.weight + part.weight, larger.by_record
            )
        else:
            found.append(part)
    kept = [one for one in found if one.peak != 0.0]
    largest = max((one.weight for one in kept), default=0.0)
    chosen = sorted(kept, key=lambda one: -one.weight)[:_MOST]
    return tuple(sorted((one for one in chosen if one.weight > 0.05 * largest), key=lambda one: one.start))


def course_text(fit: FitResult, stretches: Sequence[Stretch]) -> str:
    """One channel in words: ``in position the model is too high by up to 0.4 mm from 0.2 to 1.2 s``."""
    if not stretches:
        return ""
    measurements = fit.problem.measurements
    channel = stretches[0].channel
    unit = parse_unit(measurements.units[measurements.outputs.index(channel)])
    shown = "K" if unit.offset else unit.text
    end = max(float(fit.problem.records[k].times[-1]) for k in fit.fitted)
    largest = max(stretches, key=lambda one: one.weight)
    parts: list[str] = []
    before = 0.0
    for one in stretches:
        side = "high" if one.peak > 0.0 else "low"
        whole = one.start <= 0.0 and one.end >= 0.999 * end
        when = "all the time" if whole else f"from {_seconds(one.start)} to {_seconds(one.end)} s"
        again = parts and one.peak * before > 0.0
        size = f"by up to {abs(one.peak) / unit.factor:.2g} {shown} {when}"
        text, before = size if again else f"too {side} {size}", one.peak
        parts.append(text + (_dependence(fit, one, unit.factor, shown) if one is largest else ""))
    return f"in {channel} the model is {', then '.join(parts)}"


def _seconds(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _timed(fit: FitResult) -> bool:
    """Samples over time, not the rows of a table."""
    return not fit.problem.measurements.table


def _parts(fit: FitResult, column: int) -> list[Stretch]:
    """The parts of every phase in the order of time; the peak of one that does not count is 0."""
    channel = fit.problem.measurements.outputs[column]
    noise = fit.problem.noise.channels[column]
    sigma = float(fit.problem.noise.sigma[column])
    spread = math.sqrt((1.0 + noise.correlation) / (1.0 - noise.correlation))
    first = fit.problem.records[fit.fitted[0]]
    found = []
    for phase in range(len(first.phases)):
        for low, high in pairwise(_PARTS):
            pieces = [_piece(fit, k, column, phase, (low, high)) for k in fit.fitted]
            means = np.array([float(error.mean()) if error.size else math.nan for error, _, _ in pieces])
            count = sum(error.size for error, _, _ in pieces)
            if not count:
                continue
            mean = float(np.nanmean(means))
            counts = abs(mean) > max(_NOTABLE * sigma, _SURE * sigma * spread / math.sqrt(count))
            found.append(
                Stretch(
                    channel=channel,
                    start=float(np.nanmedian([start for _, start, _ in pieces])),
                    end=float(np.nanmedian([stop for _, _, stop in pieces])),
                    peak=mean if counts else 0.0,
                    weight=math.sqrt(count) * (mean / sigma) ** 2 if counts else 0.0,
                    by_record=means,
                )
            )
    return found


def _piece(
    fit: FitResult, k: int, column: int, phase: int, part: tuple[float, float]
) -> tuple[Floats, float, float]:
    """Errors of one record in a part of a phase, and when the part begins and ends."""
    record = fit.problem.records[k]
    inside = record.phase == phase
    if not inside.any():
        return np.empty(0), math.nan, math.nan
    times = record.times[inside]
    begin, length = float(times[0]), float(times[-1] - times[0])
    start, end = begin + part[0] * length, begin + part[1] * length
    rows = inside & fit.problem.ok[k][:, column] & (record.times >= start)
    rows &= record.times <= end if part[1] == 1.0 else record.times < end
    return fit.outputs[k][rows, column] - record.values[rows, column], start, end


def _dependence(fit: FitResult, stretch: Stretch, factor: float, shown: str) -> str:
    """The variable that the records' errors follow, with the error at its ends; empty where none is."""
    measurements = fit.problem.measurements
    units = variable_units(measurements)
    best, told = _FOLLOWS, ""
    own = sorted(measurements.variables, key=lambda name: stretch.channel not in name)
    for name in own:
        values = np.array([fit.problem.records[k].condition.get(name, math.nan) for k in fit.fitted])
        good = np.isfinite(values) & np.isfinite(stretch.by_record)
        if good.sum() < 3 or np.ptp(values[good]) == 0.0 or np.ptp(stretch.by_record[good]) == 0.0:
            continue
        follows = abs(float(np.corrcoef(values[good], stretch.by_record[good])[0, 1]))
        if follows > best + _BETTER * bool(told):
            best = follows
            places = np.flatnonzero(good)
            low, high = (places[int(pick(values[good]))] for pick in (np.argmin, np.argmax))
            if abs(stretch.by_record[high] - stretch.by_record[low]) < _CHANGES * abs(stretch.peak):
                continue
            ends = (
                f"{stretch.by_record[at] / factor:+.2g} {shown} at {name} "
                f"{show(float(values[at]), units[name], digits=3)}"
                for at in (low, high)
            )
            told = f" ({', '.join(ends)})"
    return told
