"""A model on one group of records that no fit saw: how good it is there, and what would remove its error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from rigctl.analysis.agreement.error_course import Stretch
from rigctl.analysis.comparison_result import in_unit
from rigctl.analysis.remedies import Remedy
from rigctl.model.fit.errors import ChannelError, whitened_residual
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import condition_text, variable_units
from rigctl.notebook import worded

#: an error larger than where the model was fitted, by no more than this factor, counts as equally good
_AS_GOOD = 1.1
#: most variables by which a group or a record is described
MOST_VARIABLES = 2


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
        """How good the model is here; where it is worse, how, and what would remove the error."""
        return worded(self, "held_out.statement")

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
