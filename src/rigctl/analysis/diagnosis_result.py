"""What a diagnosis returns, for people and for programs.

`Diagnosis` holds the verdict with everything that it rests on: the comparison before, the best set, every
set that was tried, the ranking, rivals, checks and levels. `design`, `learn` and `discover` start from it,
so that it keeps the fits themselves and not their summaries. The words are made in `rigctl.answers`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any

from rigctl.analysis.agreement.sensors import SensorBudget, sensor_budget
from rigctl.analysis.agreement.uncertainty_budget import UncertaintyBudget, uncertainty_budgets
from rigctl.analysis.agreement.undecided import Decision
from rigctl.analysis.bootstrap import Bootstrap
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.evidence import Evidence
from rigctl.analysis.laws.answer import LawAnswer
from rigctl.analysis.search.identity import Levels, certain_members
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.remainder import Remainder
from rigctl.effects.declaration import EffectParameter
from rigctl.json_values import finite_or_none
from rigctl.model.fit.assumptions import Conditional, conditional_document
from rigctl.model.fit.reached_bounds import ReachedBound, reached_bounds
from rigctl.model.fit.undetermined import first_statements
from rigctl.model.measured.note import Note
from rigctl.model.validity import Departure
from rigctl.notebook import as_html, documented, one_line, worded
from rigctl.units import parse_unit, significant, with_uncertainty

if TYPE_CHECKING:
    import pandas as pd

    from rigctl.analysis.conclusion import Conclusion, Doubt
    from rigctl.analysis.single_values.next_values import NextStep


@dataclass(frozen=True)
class Exclusion:
    """An effect that cannot, by itself, be what is missing.

    Attributes
    ----------
    reached: the share of the missing change that it makes at its best fit: 0 for none, negative for the wrong
        direction; `at_most` the largest share at any size tried, up to the largest usual one.
    only: the conditions at which it makes at least half of the change; empty if at none or at all of them.
    worse: by how many standard deviations it fits worse than the best effect.
    """

    effect: str
    reached: float
    only: tuple[str, ...]
    worse: float
    at_most: float

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "effect": self.effect,
            "reached": self.reached,
            "at_most": self.at_most,
            "only": list(self.only),
            "worse": self.worse,
        }


class Verdict(StrEnum):
    """The conclusion of a diagnosis about the model."""

    ADEQUATE = "adequate"  #: the data show nothing that the model lacks
    MISSING_EFFECT = "missing_effect"  #: one set of effects explains the misfit, and no other does so as well
    AMBIGUOUS = "ambiguous"  #: several effects explain it, and these data cannot distinguish them
    OUTSIDE_LIBRARY = "outside_library"  #: something is missing that no set of effects explains well enough
    UNDECIDED = "undecided"  #: noise, a bound, or a missing effect: these data cannot tell which


@dataclass(frozen=True)
class FoundParameter:
    """A fitted parameter of an effect, in the unit in which it is shown.

    `std` is 0 if the fit ended at a bound of the parameter, and NaN if it is not known. `unusual` is True if
    the value lies outside the parameter's usual range. `conditional`: what it is over the ranges of assumed
    numbers that it holds for; None if it depends on none.
    """

    value: float
    unit: str
    std: float
    unusual: bool = False
    conditional: Conditional | None = None

    @classmethod
    def of(
        cls, declared: EffectParameter, value: float, std: float, conditional: Conditional | None = None
    ) -> FoundParameter:
        """A parameter with a value and its standard deviation, SI."""
        unit = parse_unit(declared.unit)
        shown = unit.from_si(value, difference=declared.difference)
        return cls(shown, declared.unit, std / unit.factor, declared.unusual(value), conditional)

    def __str__(self) -> str:
        """As displayed, e.g. ``(4.00 ± 0.10)e-15 m^3``; an unknown standard deviation is left out.

        With an assumed number ``0.0061 N*m if resistance = 2 ohm (assumed); 0.003 to 0.012 over its range``.
        """
        if self.conditional is not None:
            value = f"{significant(self.value, 2)} {'' if self.unit == '1' else self.unit}".strip()
            return f"{value} {self.conditional.clause(self.unit)}"
        return with_uncertainty(self.value, self.std, self.unit) + ("" if self.std else " at its bound")


@dataclass(frozen=True)
class Ranked:
    """One effect of the ranking.

    Attributes
    ----------
    probability: that it is among the missing effects, given that one of the sets tried is right.
    score_p_value: family-wise p-value of the score test on the model as given.
    delta_bic: mBIC with it less mBIC without it; negative is better.
    kappa: the share of its signature that the fitted parameters cannot imitate.
    hidden_in: the fitted parameter that imitates most of it; ``record`` if the record-level nuisance
        parameters imitate most of it.
    heldout_before, heldout_after: noise-normalised RMSE in cross-validation; NaN if not computed.
    error_drop: relative decrease of the noise-normalised RMSE.
    size: λ, in sigmas of the data.
    """

    effect: str
    probability: float
    score_p_value: float
    delta_bic: float
    kappa: float
    hidden_in: str
    heldout_before: float
    heldout_after: float
    error_drop: float
    size: float
    parameters: Mapping[str, FoundParameter]

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "effect": self.effect,
            "probability": self.probability,
            "score_p_value": self.score_p_value,
            "delta_bic": self.delta_bic,
            "kappa": self.kappa,
            "hidden_in": self.hidden_in,
            "heldout_before": finite_or_none(self.heldout_before),
            "heldout_after": finite_or_none(self.heldout_after),
            "error_drop": self.error_drop,
            "size": self.size,
            "parameters": {
                name: {
                    "value": one.value,
                    "unit": one.unit,
                    "std": finite_or_none(one.std),
                    "unusual": one.unusual,
                    **conditional_document(one.conditional, one.unit),
                }
                for name, one in self.parameters.items()
            },
        }


@dataclass(frozen=True)
class Drift:
    """How a fitted parameter changed when the effects were added; in the unit in which it is shown.

    Attributes
    ----------
    before_std, after_std: standard deviations of the two values; 0 at a bound, NaN if not known.
    """

    parameter: str
    before: float
    after: float
    unit: str
    before_std: float = math.nan
    after_std: float = math.nan


@dataclass(frozen=True)
class Diagnosis:
    """The verdict, and all the evidence for and against it.

    Attributes
    ----------
    verdict, effects: what is missing: the most probable set, empty if nothing is.
    classes: groups of effects that these data cannot distinguish; each holds one of `effects`.
    indistinguishable: pairs of such effects.
    ranking: effects by probability, the most probable first.
    untestable: effects that these data cannot test, with what would make them testable.
    drift: changes of the fitted parameters.
    conclusion: how the verdict was reached, with what is uncertain about the effects.
    evidence: for and against it.
    before: the model as given.
    best: the fit with `effects`.
    trials: every set that was refitted.
    unproven_after: channels whose errors with the best set are not shown to be noise.
    remainder: what the best set leaves; None if the tests find nothing any more, or there is no set.
    doubt: why these data cannot tell whether anything is missing: for `OUTSIDE_LIBRARY`, for `ADEQUATE` if a
        test rejects a model whose error is below the noise, and for `UNDECIDED` by a bound; None if they can.
    excluded: for a table, effects that cannot by themselves be what is missing.
    next_steps: for a table, what to measure next.
    levels: for each of `effects`, how far the answer goes: its location, its explanatory variables, its law.
    laws: for each of `effects`, and for those already in the model, the law as estimated from the data.
    outside: where the model with `effects` leaves the ranges over which their laws were learned.
    next_experiment: what to measure next, machine-readable; None if not requested, or nothing is left.
    bootstrap: intervals of the parameters of the model with `effects`; None if not requested.
    unconfirmed: those of `effects` that failed cross-validation, if nothing else speaks against them: more
        records may settle it.
    decided_by: what would decide what is open: slow noise or an effect, an error of a sensor or an effect.
    with_exact_sensors: if the model agrees only because sensors may be wrong as stated, the diagnosis with
        exact ones.
    if_exact: if effects are named beside errors of sensors, what exact ones would show; None if that is the
        same.
    """

    runs: tuple[str, ...]
    model: str
    verdict: Verdict
    effects: tuple[str, ...]
    classes: tuple[tuple[str, ...], ...]
    indistinguishable: tuple[tuple[str, str], ...]
    ranking: tuple[Ranked, ...]
    untestable: tuple[tuple[str, str], ...]
    drift: tuple[Drift, ...]
    conclusion: Conclusion
    evidence: tuple[Evidence, ...]
    held_out: tuple[str, ...]
    notes: tuple[Note, ...]
    before: ModelComparison = field(repr=False)
    best: RefittedSet = field(repr=False)
    trials: tuple[RefittedSet, ...] = field(repr=False)
    p_value_after: float = math.nan
    unproven_after: tuple[str, ...] = ()
    excluded: tuple[Exclusion, ...] = ()
    next_steps: tuple[NextStep, ...] = ()
    remainder: Remainder | None = None
    doubt: Doubt | None = None
    levels: tuple[Levels, ...] = ()
    laws: tuple[LawAnswer, ...] = ()
    outside: tuple[Departure, ...] = ()
    next_experiment: Mapping[str, Any] | None = None
    bootstrap: Bootstrap | None = None
    unconfirmed: tuple[str, ...] = ()
    decided_by: tuple[Decision, ...] = ()
    with_exact_sensors: Diagnosis | None = field(default=None, repr=False)
    if_exact: Evidence | None = None

    @property
    def statement(self) -> str:
        """The verdict in words."""
        return worded(self, "findings.verdict.statement")

    @property
    def slot(self) -> str:
        """The equation with the most evidence for a missing term, "" if there is none."""
        before = self.before
        if before.adequacy.only_misread:
            return ""
        return "" if before.adequate or not before.slots else before.slots[0].slot

    @cached_property
    def bounds(self) -> tuple[ReachedBound, ...]:
        """The model's parameters that its fit drove to a bound, or that with `effects` did."""
        with_effects = reached_bounds(self.best.fit) if self.effects else ()
        before = self.before.bounds
        known = {(one.parameter, one.side) for one in before}
        return (*before, *(one for one in with_effects if (one.parameter, one.side) not in known))

    @property
    def first(self) -> tuple[str, ...]:
        """What has to be known before any effect: parameters that ended at a bound, and those that these data
        do not determine."""
        return first_statements(self.bounds, self.before.undetermined)

    @property
    def certain_besides(self) -> tuple[str, ...]:
        """Of several effects that leave something, those of which something is certain all the same."""
        several = len(self.effects) > 1 and self.remainder is not None
        return certain_members(self.levels) if several else ()

    @property
    def title(self) -> str:
        """The verdict as a short title."""
        return worded(self, "findings.verdict.title")

    @property
    def further_evidence(self) -> tuple[Evidence, ...]:
        """The evidence that the statement does not include already."""
        return tuple(one for one in self.evidence if not one.stated)

    @property
    def contradicted(self) -> bool:
        """Whether nothing is said to be missing, and a free correction beats the model all the same."""
        return self.verdict is Verdict.ADEQUATE and self.before.contradicted

    @property
    def instead_of_sensors(self) -> tuple[str, ...]:
        """The effects that may explain what the errors of sensors explain too."""
        exact = self.with_exact_sensors
        if exact is None:
            return ()
        return tuple(dict.fromkeys([*exact.effects, *(name for names in exact.classes for name in names)]))

    @cached_property
    def sensors(self) -> SensorBudget | None:
        """The errors of calibrations and clocks, beside the effects if some are named; None without any."""
        return sensor_budget(self.best.fit) if self.effects else self.before.sensors

    @property
    def budgets(self) -> tuple[UncertaintyBudget, ...]:
        """What makes the fitted numbers uncertain, with the effects that are named."""
        return uncertainty_budgets(self.best.fit if self.effects else self.before.fit)

    def document(self) -> dict[str, Any]:
        """The machine-readable answer."""
        return documented(self, "diagnosis_document")

    def summary(self) -> str:
        """The verdict in a few lines."""
        lines = [*self.first, f"{self.verdict.value}: {self.statement}"]
        lines += [
            f"  {one.probability:6.1%}  {one.effect}  (score p {one.score_p_value:.2g}, "
            f"ΔmBIC {one.delta_bic:+.1f})"
            for one in self.ranking[:5]
        ]
        return "\n".join(lines)

    def frame(self) -> pd.DataFrame:
        """The ranking, one row for each effect."""
        import pandas as pd

        rows = [one.document() for one in self.ranking]
        return pd.DataFrame([{k: v for k, v in row.items() if k != "parameters"} for row in rows])

    def __repr__(self) -> str:
        """The verdict on one line."""
        effects = f" {' + '.join(self.effects)}" if self.effects else ""
        return one_line(self, f"of {self.model}: {self.verdict.value}{effects}")

    def _repr_html_(self) -> str:
        """The summary and the ranking, as a notebook shows them."""
        return as_html(self.summary(), self.frame())
