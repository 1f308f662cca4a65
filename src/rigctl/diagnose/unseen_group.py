"""A group of records that no fit saw, and how the model does there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from rigctl.compare.channel_document import in_unit
from rigctl.compare.localise import variable_units
from rigctl.diagnose.error_course import Stretch
from rigctl.diagnose.remedies import Remedy
from rigctl.model.fit.errors import ChannelError, whitened_residual
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import condition_text

#: errors are as good as where they were fitted up to this factor
_AS_GOOD = 1.1
_MOST_VARIABLES = 2


@dataclass(frozen=True)
class Unseen:
    """A model on one group of records that were left out of its fits and of every choice.

    Attributes
    ----------
    why: held out, or not chosen by "only".
    condition: the condition that held them out, or that they do not fulfil.
    where: what tells them from the fitted records, e.g. ``heater_1 0 %``; "" when nothing does.
    fit: the model there, these records being its fitted ones: its own parameters as they are, each record's
        own unknowns fitted.
    fitted: its errors where it was fitted.
    course: how each channel's error runs over the time of a record; only where it is not as good.
    remedies: what would make up for it, the best first.
    slot: the equation that most wants a term there, "" when none does; `slot_meaning` in words.
    sentences: how good the model is here; where it is worse, how, and what would make up for it.
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
        """True when no channel is worse."""
        return not self.worse

    @property
    def statement(self) -> str:
        """The sentences in one."""
        return ". ".join(self.sentences)

    def called(self, label: str) -> str:
        """A record with the operating point that tells it from the others."""
        measurements = self.fit.problem.measurements
        record = {one.label: one for one in measurements.records}[label]
        known = {name: record.condition[name] for name in measurements.variables if name in record.condition}
        text = condition_text(dict(list(known.items())[:_MOST_VARIABLES]), variable_units(measurements))
        return f"{label} ({text})" if text else label

    def excess(self) -> dict[str, float]:
        """By record, its whitened squares beyond what noise makes."""
        problem, found = self.fit.problem, {}
        for k in self.fit.fitted:
            squares = float(np.square(whitened_residual(problem, self.fit.outputs[k], k)).sum())
            found[problem.records[k].label] = squares - problem.whiteners[k].size
        return found

    def channels(self) -> dict[str, dict[str, Any]]:
        """By channel, in the channels' units; `bias` is of model less measured."""
        measurements = self.fit.problem.measurements
        shown = dict(zip(measurements.outputs, measurements.units, strict=True))
        found = {}
        for name, error in self.fit.errors.items():
            there = self.fitted.get(name)
            here = in_unit(error, shown[name])
            found[name] = {
                "rmse": here["rmse"],
                "fitted_rmse": None if there is None else in_unit(there, shown[name])["rmse"],
                "noise": here["noise"],
                "bias": here["bias"],
                "unit": here["unit"],
            }
        return found

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


def _worse(here: Mapping[str, ChannelError], fitted: Mapping[str, ChannelError]) -> tuple[str, ...]:
    return tuple(
        name
        for name, error in here.items()
        if name in fitted and error.rmse > _AS_GOOD * max(fitted[name].rmse, error.noise)
    )
