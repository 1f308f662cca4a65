"""A model on one group of records that no fit saw: how good it is there, and what would remove its error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from rigctl.analysis.agreement.error_course import Stretch, course_text
from rigctl.analysis.comparison_result import in_unit
from rigctl.analysis.remedies import Remedy, still_missing
from rigctl.model.fit.errors import ChannelError, whitened_residual
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import condition_text, variable_units
from rigctl.units import parse_unit

#: an error larger than where the model was fitted, by no more than this factor, counts as equally good
_AS_GOOD = 1.1
#: most variables by which a group or a record is described
MOST_VARIABLES = 2
#: one record is named if it holds more than this share of the misfit
_MOST_OF_IT = 0.4


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
        text = condition_text(dict(list(known.items())[:MOST_VARIABLES]), variable_units(measurements))
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
