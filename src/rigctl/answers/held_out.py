"""Records that no fit saw, in words: how good the model is there, and what would remove its error.

In: a `HeldOutGroup`. Out: sentences, in the order in which one would look for the cause: the errors, when
they occur, in which record, and which single change of the model would remove them.
"""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.analysis.agreement.error_course import Stretch, dependence
from rigctl.analysis.held_out_group import HeldOutGroup
from rigctl.analysis.remedies import Remedy, still_missing
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import variable_units
from rigctl.units import parse_unit, show, significant

#: one record is named if it holds more than this share of the misfit
_MOST_OF_IT = 0.4


def statement(evaluated: HeldOutGroup) -> str:
    """The sentences in one."""
    return ". ".join(sentences(evaluated))


def sentences(evaluated: HeldOutGroup) -> tuple[str, ...]:
    """How good the model is there; where it is worse, the time series of its error, and what would remove
    it."""
    errors = ", ".join(
        f"{name} {one['rmse']:.3g} {one['unit']} (fitted {one['fitted_rmse']:.3g}, noise {one['noise']:.3g})"
        for name, one in evaluated.channels().items()
        if one["fitted_rmse"] is not None
    )
    if evaluated.as_good:
        parts = [f"{_which(evaluated)} the model is as good as where it was fitted: {errors}"]
    else:
        parts = [f"{_which(evaluated)} the model misses something; its error there: {errors}"]
        parts += _what_is_wrong(evaluated)
    return tuple(part[0].upper() + part[1:] for part in parts if part)


def _what_is_wrong(evaluated: HeldOutGroup) -> list[str]:
    """The time series of the error, where most of it is, and what would remove it."""
    # From what is seen to what explains it: when in a record it is wrong, whether one record has most of it,
    # which single change (a start, values, an effect) would remove it, and only if none does, where a term is
    # missing.
    parts = [course_text(evaluated.fit, evaluated.course.get(name, ())) for name in evaluated.worse]
    parts.append(_one_record(evaluated))
    parts += [_remedy(evaluated, one) for one in evaluated.remedies[:1]]
    parts += [_less(one) for one in evaluated.remedies[1:]]
    if evaluated.slot and still_missing(evaluated.remedies):
        parts.append(
            f"the equation that most probably lacks a term there: {evaluated.slot} ({evaluated.slot_meaning})"
        )
    return parts


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
            f"({moved}): what they describe has other values there"
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


def _dependence(fit: FitResult, stretch: Stretch, factor: float, shown: str) -> str:
    """The variable that the records' errors follow, with the error at its ends; empty if there is none."""
    found = dependence(fit, stretch)
    if found is None:
        return ""
    name, unit = found.variable, variable_units(fit.problem.measurements)[found.variable]
    ends = (
        f"{significant(error / factor, 2, sign=True)} {shown} at {name} {show(value, unit, digits=3)}"
        for value, error in found.ends
    )
    return f" ({', '.join(ends)})"
