"""The model on the records that no fit saw: as good as on the others, or what it still misses there.

The records are judged in groups of one condition: by their error, by the time series of the error within a
record, and by what would remove it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import Comparison, ModelComparison, in_unit
from rigctl.analysis.fitting import OnProgress, fit_model, no_progress
from rigctl.analysis.remedies import Remedy, remedies, still_missing
from rigctl.model.fit.errors import ChannelError, whitened_residual
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import condition_text, variable_units
from rigctl.model.measured.record import MeasuredRecord
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


#: an error larger than where the model was fitted, by no more than this factor, counts as equally good
_AS_GOOD = 1.1
_MOST_VARIABLES = 2


@dataclass(frozen=True)
class HeldOutGroup:
    """A model on one group of records that were excluded from its fits and from every choice.

    Attributes
    ----------
    why: held out, or not selected by "only".
    condition: the condition that held them out, or that they do not fulfil.
    where: what distinguishes them from the fitted records, e.g. ``heater_1 0 %``; "" if nothing does.
    fit: the model with these records as its fitted ones: its own parameters unchanged, the record-level
        unknowns fitted.
    fitted: its errors where it was fitted.
    course: the time series of each channel's error within a record; only if the model is worse here.
    remedies: what would remove the error, the best first.
    slot: the equation with the most evidence for a missing term, "" if there is none; `slot_meaning` in
        words.
    sentences: how good the model is here; where it is worse, how, and what would remove the error.
    """

    why: Literal["hold_out", "only"]
    condition: str
    where: str
    fit: FitResult = field(repr=False)
    fitted: Mapping[str, ChannelError] = field(repr=False)
    course: Mapping[str, tuple[Stretch, ...]] = field(default_factory=dict, repr=False)
    remedies: tuple[Remedy, ...] = ()
    slot: str = ""
    slot_meaning: str = ""
    sentences: tuple[str, ...] = ()

    @property
    def records(self) -> tuple[str, ...]:
        """The records' labels."""
        return tuple(self.fit.problem.records[k].label for k in self.fit.fitted)

    @property
    def worse(self) -> tuple[str, ...]:
        """The channels whose error is larger here than where the model was fitted."""
        return _worse(self.fit.errors, self.fitted)

    @property
    def as_good(self) -> bool:
        """True if no channel is worse."""
        return not self.worse

    @property
    def statement(self) -> str:
        """The sentences in one."""
        return ". ".join(self.sentences)

    def called(self, label: str) -> str:
        """The record's label with the operating point that distinguishes it from the others."""
        measurements = self.fit.problem.measurements
        record = {one.label: one for one in measurements.records}[label]
        known = {name: record.condition[name] for name in measurements.variables if name in record.condition}
        text = condition_text(dict(list(known.items())[:_MOST_VARIABLES]), variable_units(measurements))
        return f"{label} ({text})" if text else label

    def excess(self) -> dict[str, float]:
        """By record, its sum of squared whitened residuals less what the noise contributes."""
        problem, shares = self.fit.problem, {}
        for k in self.fit.fitted:
            squares = float(np.square(whitened_residual(problem, self.fit.outputs[k], k)).sum())
            shares[problem.records[k].label] = squares - problem.whiteners[k].size
        return shares

    def channels(self) -> dict[str, dict[str, Any]]:
        """By channel, in the channels' units; `bias` is of model less measured."""
        measurements = self.fit.problem.measurements
        shown = dict(zip(measurements.outputs, measurements.units, strict=True))
        errors = {}
        for name, error in self.fit.errors.items():
            fitted = self.fitted.get(name)
            evaluated = in_unit(error, shown[name])
            errors[name] = {
                "rmse": evaluated["rmse"],
                "fitted_rmse": None if fitted is None else in_unit(fitted, shown[name])["rmse"],
                "noise": evaluated["noise"],
                "bias": evaluated["bias"],
                "unit": evaluated["unit"],
            }
        return errors

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "why": self.why,
            "condition": self.condition,
            "where": self.where,
            "records": list(self.records),
            "as_good": self.as_good,
            "channels": self.channels(),
            "remedies": [
                {"kind": one.kind, "names": list(one.names), "share": one.share} for one in self.remedies
            ],
            "slot": self.slot,
            "statement": self.statement,
        }


def _worse(evaluated: Mapping[str, ChannelError], fitted: Mapping[str, ChannelError]) -> tuple[str, ...]:
    return tuple(
        name
        for name, error in evaluated.items()
        if name in fitted and error.rmse > _AS_GOOD * max(fitted[name].rmse, error.noise)
    )


#: one record is named if it holds more than this share of the misfit
_MOST_OF_IT = 0.4


def held_out_sentences(evaluated: HeldOutGroup) -> tuple[str, ...]:
    """How good the model is there; where it is worse, the time series of its error, and what would remove
    it."""
    errors = ", ".join(
        f"{name} {one['rmse']:.3g} {one['unit']} (fitted {one['fitted_rmse']:.3g}, noise {one['noise']:.3g})"
        for name, one in evaluated.channels().items()
        if one["fitted_rmse"] is not None
    )
    if evaluated.as_good:
        return (f"{_which(evaluated)} the model is as good as where it was fitted: {errors}",)
    parts = [f"{_which(evaluated)} the model misses something; its error there: {errors}"]
    parts += [course_text(evaluated.fit, evaluated.course.get(name, ())) for name in evaluated.worse]
    parts.append(_one_record(evaluated))
    parts += [_remedy(evaluated, one) for one in evaluated.remedies[:1]]
    parts += [_less(one) for one in evaluated.remedies[1:]]
    if evaluated.slot and still_missing(evaluated.remedies):
        parts.append(
            f"the equation that most probably lacks a term there: {evaluated.slot} ({evaluated.slot_meaning})"
        )
    return tuple(part for part in parts if part)


def _which(evaluated: HeldOutGroup) -> str:
    count = len(evaluated.records)
    records = f"{count} record{'' if count == 1 else 's'}"
    if evaluated.why == "hold_out":
        return f"on the {records} held out by '{evaluated.condition}'"
    where = f" with {evaluated.where}" if evaluated.where else ""
    return f"on the {records}{where} that '{evaluated.condition}' left out"


def _one_record(evaluated: HeldOutGroup) -> str:
    """The record that holds most of the misfit, if one does."""
    count = len(evaluated.records)
    excess = evaluated.excess()
    largest = max(excess, key=lambda label: excess[label])
    share = max(excess[largest], 0.0) / (sum(max(one, 0.0) for one in excess.values()) or 1.0)
    if count < 2 or share < max(_MOST_OF_IT, 2.0 / count):
        return ""
    return f"{100 * share:.0f} % of it is in one record, {evaluated.called(largest)}"


def _remedy(evaluated: HeldOutGroup, one: Remedy) -> str:
    share = f"{100 * one.share:.0f} % of it"
    if one.kind == "starts":
        names = " and ".join(one.names)
        return (
            f"{share} would disappear ({_errors(evaluated, one)}) if {names} did not start at rest: these "
            "records start after something that they do not show, and the state in which it left the bench "
            "is not in the model. Start recording before the switch, or leave such records out"
        )
    if one.kind == "values":
        moved = ", ".join(
            f"{name} {before:.3g} to {after:.3g}{'' if unit == '1' else ' ' + unit}"
            for name, before, after, unit in one.moved
        )
        return (
            f"{share} would disappear ({_errors(evaluated, one)}) with other values of the same parameters "
            f"({moved}): the properties that they describe are different there"
        )
    return f"of the library, {one.names[0]} alone would remove {share}"


def _less(one: Remedy) -> str:
    what = {
        "starts": f"another initial value of {' and '.join(one.names)}",
        "values": "other values of the parameters",
    }
    return f"{what.get(one.kind, one.names[0])} alone would remove {100 * one.share:.0f} % of it"


def _errors(evaluated: HeldOutGroup, one: Remedy) -> str:
    measurements = evaluated.fit.problem.measurements
    units = dict(zip(measurements.outputs, measurements.units, strict=True))
    errors = []
    for name in evaluated.worse:
        unit = parse_unit(units[name])
        errors.append(f"{name} to {one.rmse[name] / unit.factor:.3g} {'K' if unit.offset else units[name]}")
    return ", ".join(errors)


_FEW = 4


def unseen(
    compared: Comparison, model: ModelComparison, *, on_progress: OnProgress | None = None
) -> tuple[HeldOutGroup, ...]:
    """Judge `model` on the records that `compared` left out: held out, or not selected.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    report = on_progress or no_progress
    problem, choice = model.fit.problem, compared.choice
    inside = [problem.records[k] for k in model.fit.fitted]
    evaluated = []
    if model.fit.held_out:
        report("Evaluating the records that were held out")
        result = replace(model.fit, fitted=model.fit.held_out, solution=None)
        evaluated.append(_group(model, inside, result, "hold_out", choice.hold_out))
    if choice.rest is not None:
        report("Evaluating the records that were not selected")
        measurements, noise = choice.rest
        result = fit_model(model.fit.model, measurements, noise, refit=False)
        evaluated.append(_group(model, inside, result, "only", choice.only))
    return tuple(evaluated)


def _group(
    model: ModelComparison,
    inside: Sequence[MeasuredRecord],
    result: FitResult,
    why: Literal["hold_out", "only"],
    condition: str,
) -> HeldOutGroup:
    units = variable_units(model.fit.problem.measurements) | variable_units(result.problem.measurements)
    records = [result.problem.records[k] for k in result.fitted]
    plain = HeldOutGroup(why, condition, _what(records, inside, units), result, model.fit.errors)
    if plain.as_good:
        return _stated(plain)
    judged = judge(result, model.name, excluded=model.excluded)
    wanted = [slot for slot in judged.slots[:1] if slot.log_evidence > 0.0]
    detailed = replace(
        plain,
        course={name: error_course(result, name) for name in plain.worse},
        remedies=remedies(result, judged),
        slot=wanted[0].slot if wanted else "",
        slot_meaning=wanted[0].meaning if wanted else "",
    )
    return _stated(detailed)


def _stated(evaluated: HeldOutGroup) -> HeldOutGroup:
    return replace(
        evaluated, sentences=tuple(one[0].upper() + one[1:] for one in held_out_sentences(evaluated))
    )


def _what(group: Sequence[MeasuredRecord], inside: Sequence[MeasuredRecord], units: Mapping[str, str]) -> str:
    """The variables whose values do not occur in the fitted records, with these values."""
    parts = []
    for name in dict.fromkeys(name for record in group for name in record.condition):
        group_values = {_rounded(record.condition[name]) for record in group if name in record.condition}
        others = {_rounded(record.condition[name]) for record in inside if name in record.condition}
        if group_values & others or not others:
            continue
        values = sorted(group_values)
        if len(values) <= _FEW:
            parts.append(f"{name} {', '.join(show(value, units[name], digits=3) for value in values)}")
        else:
            ends = (show(value, units[name], digits=3) for value in (values[0], values[-1]))
            parts.append(f"{name} {' to '.join(ends)}")
    return ", ".join(parts[:_MOST_VARIABLES])


def _rounded(value: float) -> float:
    return float(np.format_float_scientific(value, precision=4))
