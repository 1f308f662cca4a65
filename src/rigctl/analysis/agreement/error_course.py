"""The time series of a model's error within the records: when it has which sign, and on what it depends.

In: a fit and one of its channels. Out: `Stretch`es of time, and a variable that the records' errors in one of
them follow. The mean over the records of model less measured is taken in parts of each phase, because their
noise averages out and what the model lacks does not; for records that no fit saw, whose error has to be
described even where no effect explains it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.fit import FitResult

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


def _timed(fit: FitResult) -> bool:
    """Whether the data are samples over time, not the rows of a table."""
    return not fit.problem.measurements.table


def _parts(fit: FitResult, column: int) -> list[Stretch]:
    """The parts of every phase in order of time; the peak of an insignificant part is 0."""
    channel = fit.problem.measurements.outputs[column]
    # The mean of n readings with correlation ρ of neighbours has the standard error σ·√((1 + ρ)/(1 − ρ)/n).
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


@dataclass(frozen=True)
class Dependence:
    """The variable that the records' errors follow, and the ends of its range; SI.

    Attributes
    ----------
    ends: (value of the variable, error) at its lowest and its highest value.
    """

    variable: str
    ends: tuple[tuple[float, float], tuple[float, float]]


def dependence(fit: FitResult, stretch: Stretch) -> Dependence | None:
    """The variable that the records' errors follow most closely; None if there is none."""
    measurements = fit.problem.measurements
    best, found = _FOLLOWS, None
    variables = sorted(measurements.variables, key=lambda name: stretch.channel not in name)
    for name in variables:
        values = np.array([fit.problem.records[k].condition.get(name, math.nan) for k in fit.fitted])
        good = np.isfinite(values) & np.isfinite(stretch.by_record)
        if good.sum() < 3 or np.ptp(values[good]) == 0.0 or np.ptp(stretch.by_record[good]) == 0.0:
            continue
        follows = abs(float(np.corrcoef(values[good], stretch.by_record[good])[0, 1]))
        if follows > best + _BETTER * (found is not None):
            indices = np.flatnonzero(good)
            low, high = (indices[int(pick(values[good]))] for pick in (np.argmin, np.argmax))
            if abs(stretch.by_record[high] - stretch.by_record[low]) < _CHANGES * abs(stretch.peak):
                continue
            best = follows
            first, last = ((float(values[at]), float(stretch.by_record[at])) for at in (low, high))
            found = Dependence(name, (first, last))
    return found
