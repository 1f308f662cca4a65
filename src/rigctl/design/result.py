"""A designed experiment: the rivals, the records to take, and their predicted power.

`DesignResult` is what `rigctl.design.design` returns, for people and for programs. It keeps the diagnosis
and the writer of the procedure, so that a loop can carry the design out and compare the outcome with the
prediction. The words are made in `rigctl.answers`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.diagnosis_result import Diagnosis, FoundParameter
from rigctl.json_values import finite_or_none
from rigctl.notebook import as_html, documented, one_line, worded
from rigctl.wording import number_of

if TYPE_CHECKING:
    import pandas as pd

    from rigctl.design.procedure_text import Writer
    from rigctl.design.recipe import Recipe

Floats = NDArray[np.float64]

#: the aim of a design: distinguish rivals, detect an effect at all, or estimate its parameters better
Aim = Literal["discrimination", "detection", "precision"]
#: name of the model without any of the effects in question
NONE = "none"
#: a set with a lower probability than this is no answer
HALF = 0.5


@dataclass(frozen=True)
class DesignRival:
    """One of the explanations that the data so far leave.

    Attributes
    ----------
    name: of the effect in question; ``none`` for the model without.
    effects: all effects that are added to the model for it.
    weight: ``exp(−ΔmBIC/2)`` divided by the sum over all rivals.
    parameters: of `effects`, as refitted to all data so far.
    chi2: whitened squares that it leaves, including the priors'.
    chi2_reduced: per degree of freedom; distances are divided by it if it exceeds 1.
    std: standard deviations of all shared unknowns, SI, from the data so far.
    """

    name: str
    effects: tuple[str, ...]
    weight: float
    parameters: Mapping[str, FoundParameter]
    chi2: float
    chi2_reduced: float
    std: Mapping[str, float] = field(default_factory=dict, repr=False)

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "name": self.name,
            "effects": list(self.effects),
            "weight": self.weight,
            "chi2": self.chi2,
            "chi2_reduced": self.chi2_reduced,
            "parameters": {
                name: {"value": one.value, "unit": one.unit, "std": finite_or_none(one.std)}
                for name, one in self.parameters.items()
            },
        }


@dataclass(frozen=True)
class PredictedPower:
    """The predicted power to distinguish one rival from another, if the first is right.

    Attributes
    ----------
    truth, rival: names.
    margin: L₀, by which the data so far prefer the first, in mBIC.
    threshold: t, the margin that a verdict requires.
    separation: D, the expected deviance by the proposed records, with the rival refitted.
    spread: standard deviation of D over the posteriors.
    before, after: probability that a verdict distinguishes the two, with the data so far and with the
        records.
    """

    truth: str
    rival: str
    margin: float
    threshold: float
    separation: float
    spread: float
    before: float
    after: float

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "truth": self.truth,
            "rival": self.rival,
            "margin": self.margin,
            "threshold": self.threshold,
            "separation": self.separation,
            "spread": self.spread,
            "probability_before": self.before,
            "probability": self.after,
        }


@dataclass(frozen=True)
class Prediction:
    """One channel of a proposed record, as every rival predicts it.

    Attributes
    ----------
    channel, unit: `unit` is the one in which it is shown; every number below is in it.
    times: (n) s from the first sample.
    by_rival: (n) by the rival's name.
    sigma: (n) standard deviation of a reading.
    """

    channel: str
    unit: str
    times: Floats = field(repr=False)
    by_rival: Mapping[str, Floats] = field(repr=False)
    sigma: Floats = field(repr=False)


@dataclass(frozen=True)
class LargestDifference:
    """Where two rivals differ most in a record.

    Attributes
    ----------
    sigmas: the largest difference, in standard deviations of a reading.
    """

    channel: str
    first: str
    second: str
    sigmas: float


@dataclass(frozen=True)
class ProposedRecord:
    """A record to take.

    Attributes
    ----------
    settings: the operating point by name, with its unit, as displayed: ``{"oil": "60 degC"}``.
    steps: the actions during the recording, a line each.
    separation: Σ w_i·min_j D_ij that it adds to the records before it.
    of_repeat: that of the best repeat of an earlier record in its place.
    before, after: probability that the rivals are distinguished, without it and with it.
    duration: bench time including heating and settling, s.
    recorded: recorded time, s, at `rate` Hz.
    recipe: from which its procedure is written; None for a row of a table.
    """

    settings: Mapping[str, str]
    steps: tuple[str, ...]
    separation: float
    of_repeat: float
    before: float
    after: float
    duration: float
    recorded: float
    rate: float
    predictions: tuple[Prediction, ...] = field(default=(), repr=False)
    recipe: Recipe | None = field(default=None, repr=False)

    @property
    def widest(self) -> LargestDifference | None:
        """Where two rivals differ most; None if there are not two."""
        differences = [
            LargestDifference(
                one.channel,
                first,
                second,
                float(np.max(np.abs(one.by_rival[first] - one.by_rival[second]) / one.sigma)),
            )
            for one in self.predictions
            for first, second in combinations(one.by_rival, 2)
        ]
        return max(differences, key=lambda one: one.sigmas, default=None)


@dataclass(frozen=True)
class SensorSet:
    """Channels that the bench could have, and the predicted power with them.

    Attributes
    ----------
    channels: one or two of the rig file's `could_have`.
    price: as in the rig file, summed; None if one has none.
    currency: of the price.
    distinguished: number of pairs of rivals distinguished with a probability of at least a half; `of`
        all.
    separation, probability: as for the design, with the channels added for the proposed records.
    splits: the pairs that are distinguished with them and not without.
    """

    channels: tuple[str, ...]
    price: float | None
    currency: str
    distinguished: int
    of: int
    separation: float
    probability: float
    splits: tuple[tuple[str, str], ...] = ()

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "channels": list(self.channels),
            "price": self.price,
            "currency": self.currency,
            "told": self.distinguished,
            "of": self.of,
            "expected_separation": self.separation,
            "probability": self.probability,
            "splits": [list(pair) for pair in self.splits],
        }


@dataclass(frozen=True)
class PrecisionGain:
    """The precision of a parameter, in the unit in which it is shown: half-widths of 95 % intervals."""

    name: str
    unit: str
    before: float
    after: float

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {"parameter": self.name, "unit": self.unit, "before": self.before, "after": self.after}


@dataclass(frozen=True)
class Explanation:
    """What rivals stand for: the members of one set of effects are rivals of their own, but one explanation.

    Attributes
    ----------
    effects: names of the rivals; ``none`` stands for the sensors where their stated errors are enough.
    weight: of all these rivals together.
    """

    effects: tuple[str, ...]
    weight: float


@dataclass(frozen=True)
class DesignResult:
    """The next experiment.

    Attributes
    ----------
    aim: of the design.
    rivals: the most probable first.
    outlooks: for every ordered pair in question.
    records: in the order in which they are to be taken; none if nothing on this bench distinguishes the
        rivals.
    separation: D, Σ w_i·min_j D_ij of all records together.
    before, after: probability that a verdict distinguishes the right one from all others, now and with the
        records.
    duration: bench time, s.
    excluded: of several models, those that the data so far exclude.
    writer: of the records as a procedure; None for the rows of a table.
    sensor: the most useful one if no record reaches a probability of a half, or if requested.
    sensors: every set that was evaluated, the cheapest first.
    sensors_left_out: they were requested, and not evaluated because no rivals are to be distinguished.
    unknown_sensors: those that some model cannot read, and why.
    sharpened: for aim ``precision``, the parameters.
    of_random: the median worth, as `separation`, of the records with which the search started: any that the
        bench can make, one at a time.
    simulated: number of records that were simulated with every rival; None for the rows of a table, whose
        probability is that at the fits, without draws.
    """

    runs: tuple[str, ...]
    model: str
    aim: Aim
    rivals: tuple[DesignRival, ...]
    outlooks: tuple[PredictedPower, ...]
    records: tuple[ProposedRecord, ...]
    separation: float
    before: float
    after: float
    duration: float
    sensor: SensorSet | None = None
    sensors: tuple[SensorSet, ...] = ()
    sensors_left_out: bool = False
    unknown_sensors: Mapping[str, str] = field(default_factory=dict)
    sharpened: tuple[PrecisionGain, ...] = ()
    of_random: float = 0.0
    simulated: int | None = None
    excluded: tuple[str, ...] = ()
    writer: Writer | None = field(default=None, repr=False)
    diagnosis: Diagnosis | None = field(default=None, repr=False)

    @property
    def statement(self) -> str:
        """The answer in words."""
        return worded(self, "design.statement.statement")

    @property
    def procedure(self) -> str:
        """The text of a procedure for `rigctl check` and `rigctl run`; "" without records."""
        return worded(self, "design.statement.procedure")

    @property
    def separates(self) -> tuple[tuple[str, str], ...]:
        """The pairs of names in question, each once."""
        pairs: dict[frozenset[str], tuple[str, str]] = {}
        for one in self.outlooks:
            pairs.setdefault(frozenset((one.truth, one.rival)), (one.truth, one.rival))
        return tuple(pairs.values())

    @property
    def explanations(self) -> dict[str, Explanation]:
        """The explanation that each rival stands for, by the rival's name."""
        sets: dict[tuple[str, ...], list[DesignRival]] = {}
        for one in self.rivals:
            sets.setdefault(one.effects or (one.name,), []).append(one)
        return {
            one.name: Explanation(tuple(each.name for each in same), math.fsum(each.weight for each in same))
            for same in sets.values()
            for one in same
        }

    @property
    def separable(self) -> bool:
        """Whether the records distinguish the rivals with a probability of a half on the bench as it is."""
        return bool(self.records) and self.after >= HALF

    def next_experiment(self) -> dict[str, Any]:
        """The part of it in the machine-readable answer of a diagnosis."""
        return documented(self, "next_experiment")

    def as_json(self) -> dict[str, Any]:
        """The machine-readable answer: `next_experiment`, and more."""
        return documented(self, "design_document")

    def summary(self) -> str:
        """The records, and their predicted power, in a few lines."""
        return worded(self, "design.statement.summary")

    def frame(self) -> pd.DataFrame:
        """The proposed records, one row for each."""
        import pandas as pd

        return pd.DataFrame([{**one.settings, **_numbers(one)} for one in self.records])

    def __repr__(self) -> str:
        """The proposal, on one line."""
        return one_line(self, f"{number_of(len(self.records), 'record')}, P {self.after:.2g}")

    def _repr_html_(self) -> str:
        """The summary and the records, as a notebook shows them."""
        return as_html(self.summary(), self.frame())


def _numbers(record: ProposedRecord) -> dict[str, float]:
    return {
        "D": record.separation,
        "D of a repeat": record.of_repeat,
        "P": record.after,
        "duration [s]": record.duration,
    }
