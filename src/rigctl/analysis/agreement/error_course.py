"""The time series of a model's error within the records: when it has which sign, and on what it depends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import variable_units
from rigctl.units import parse_unit, show, significant

Floats = NDArray[np.float64]

#: each phase is divided into parts, finer near its start, because the response to a switch decays
_PARTS = (0.0, 1 / 27, 1 / 9, 1 / 3, 1.0)
#: a part counts if its mean differs from 0 by this many standard errors and by this share of the noise
_SURE, _NOTABLE = 6.0, 0.25
#: least correlation between a variable and the records' errors for the variable to be named
_FOLLOWS = 0.8
#: by how much the correlation with a less related variable must be larger for it to be named instead
_BETTER = 0.05
#: least difference of the errors at the ends of the variable's range, as a share of the largest error
_CHANGES = 0.3
_MOST = 3


@dataclass(frozen=True)
class Stretch:
    """A period of time in which the records' mean error keeps its sign; SI.

    Attributes
    channel: the reading.
    start, end: s from the start of the records.
    peak: the largest mean over the records, in any part of it, of model less measured.
    weight: for ranking: mean square over the noise's, times the square root of the number of samples.
    by_record: (records) the mean of each record in the part with the peak; NaN if a record has none.
    """

    channel: str
    start: float
    end: float
    peak: float
    weight: float
    by_record: Floats


def error_course(fit: FitResult, channel: str) -> tuple[Stretch, ...]:
    """The stretches that matter most, in order of time; none if there is only noise."""
    column = fit.problem.measurements.outputs.index(channel)
    stretches: list[Stretch] = []
    gap = 1.5 * fit.problem.noise.spacing
    for part in _parts(fit, column) if _timed(fit) else ():
        last = stretches[-1] if stretches else None
        if last is not None and part.start - last.end < gap and part.peak * last.peak > 0.0:
            larger = part if abs(part.peak) > abs(last.peak) else last
            stretches[-1] = Stretch(
                channel, last.start, part.end, larger.peak, last.weight + part.weight, larger.by_record
            )
        else:
            stretches.append(part)
    kept = [one for one in stretches if one.peak != 0.0]
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
    previous_peak = 0.0
    for one in stretches:
        side = "high" if one.peak > 0.0 else "low"
        throughout = one.start <= 0.0 and one.end >= 0.999 * end
        when = "all the time" if throughout else f"from {_seconds(one.start)} to {_seconds(one.end)} s"
        same_side = parts and one.peak * previous_peak > 0.0
        deviation = f"by up to {significant(abs(one.peak) / unit.factor, 2)} {shown} {when}"
        text, previous_peak = deviation if same_side else f"too {side} {deviation}", one.peak
        parts.append(text + (_dependence(fit, one, unit.factor, shown) if one is largest else ""))
    return f"in {channel} the model is {', then '.join(parts)}"


def _seconds(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _timed(fit: FitResult) -> bool:
    """Whether the data are samples over time, not the rows of a table."""
    return not fit.problem.measurements.table


def _parts(fit: FitResult, column: int) -> list[Stretch]:
    """The parts of every phase in order of time; the peak of an insignificant part is 0."""
    channel = fit.problem.measurements.outputs[column]
    noise = fit.problem.noise.channels[column]
    sigma = float(fit.problem.noise.sigma[column])
    spread = math.sqrt((1.0 + noise.correlation) / (1.0 - noise.correlation))
    first = fit.problem.records[fit.fitted[0]]
    stretches = []
    for phase in range(len(first.phases)):
        for low, high in pairwise(_PARTS):
            pieces = [_piece(fit, k, column, phase, (low, high)) for k in fit.fitted]
            means = np.array([float(error.mean()) if error.size else math.nan for error, _, _ in pieces])
            count = sum(error.size for error, _, _ in pieces)
            if not count:
                continue
            mean = float(np.nanmean(means))
            counts = abs(mean) > max(_NOTABLE * sigma, _SURE * sigma * spread / math.sqrt(count))
            stretches.append(
                Stretch(
                    channel=channel,
                    start=float(np.nanmedian([start for _, start, _ in pieces])),
                    end=float(np.nanmedian([stop for _, _, stop in pieces])),
                    peak=mean if counts else 0.0,
                    weight=math.sqrt(count) * (mean / sigma) ** 2 if counts else 0.0,
                    by_record=means,
                )
            )
    return stretches


def _piece(
    fit: FitResult, k: int, column: int, phase: int, part: tuple[float, float]
) -> tuple[Floats, float, float]:
    """Errors of one record in a part of a phase, and the start and end of the part."""
    record = fit.problem.records[k]
    inside = record.samples_of_phases[phase] if phase < len(record.phases) else np.empty(0, dtype=np.intp)
    if not inside.size:
        return np.empty(0), math.nan, math.nan
    times = record.times[inside]
    begin, length = float(times[0]), float(times[-1] - times[0])
    start, end = begin + part[0] * length, begin + part[1] * length
    counts = fit.problem.ok[k][inside, column] & (times >= start)
    rows = inside[counts & (times <= end if part[1] == 1.0 else times < end)]
    return fit.outputs[k][rows, column] - record.values[rows, column], start, end


def _dependence(fit: FitResult, stretch: Stretch, factor: float, shown: str) -> str:
    """The variable that the records' errors follow, with the error at its ends; empty if there is none."""
    measurements = fit.problem.measurements
    units = variable_units(measurements)
    best, text = _FOLLOWS, ""
    variables = sorted(measurements.variables, key=lambda name: stretch.channel not in name)
    for name in variables:
        values = np.array([fit.problem.records[k].condition.get(name, math.nan) for k in fit.fitted])
        good = np.isfinite(values) & np.isfinite(stretch.by_record)
        if good.sum() < 3 or np.ptp(values[good]) == 0.0 or np.ptp(stretch.by_record[good]) == 0.0:
            continue
        follows = abs(float(np.corrcoef(values[good], stretch.by_record[good])[0, 1]))
        if follows > best + _BETTER * bool(text):
            best = follows
            indices = np.flatnonzero(good)
            low, high = (indices[int(pick(values[good]))] for pick in (np.argmin, np.argmax))
            if abs(stretch.by_record[high] - stretch.by_record[low]) < _CHANGES * abs(stretch.peak):
                continue
            ends = (
                f"{significant(stretch.by_record[at] / factor, 2, sign=True)} {shown} at {name} "
                f"{show(float(values[at]), units[name], digits=3)}"
                for at in (low, high)
            )
            text = f" ({', '.join(ends)})"
    return text
