"""The answer of a diagnosis for one scenario, reduced to what the rates are computed from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Generic, Literal, Protocol, TypeAlias, TypeVar

from rigctl_validation.scenario import Scenario


class Trial(Protocol):
    """A trial: a campaign that hides something, or nothing."""

    @property
    def name(self) -> str:
        """All of it in one line, unique among the trials of a tier."""

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of effects that are a right answer; none if nothing is hidden."""

    def document(self) -> dict[str, Any]:
        """The trial as plain data."""


AnyTrial = TypeVar("AnyTrial", bound=Trial)
Verdict: TypeAlias = Literal[
    "adequate", "missing_effect", "ambiguous", "outside_library", "undecided", "refused"
]


@dataclass(frozen=True)
class Interval:
    """A 95 % interval of an effect's parameter, and the bench's true value, SI."""

    effect: str
    parameter: str
    truth: float
    low: float
    high: float

    @property
    def covers(self) -> bool:
        """True if it contains the true value."""
        return self.low <= self.truth <= self.high


@dataclass(frozen=True)
class Claim:
    """The claims of a diagnosis about an effect that it names: its location, variables and law."""

    effect: str
    place: bool
    driver: bool
    law: bool


@dataclass(frozen=True)
class Searched:
    """The result of a search for a formula.

    Attributes
    ----------
    gate: the reason for searching, or for not searching.
    places: the first two locations of the answer, each with those at which a term has the same signature.
    over: the variables of the first one.
    formulas: the set, as ``slot: form of variable``.
    in_set: whether it contains the planted term, or one with the same signature.
    heldout_before, heldout_after: cross-validated error of the first formula, in units of the noise.
    accepted: the first formula passes cross-validation.
    sure: a location is significant.
    """

    gate: str = ""
    places: tuple[str, ...] = ()
    over: tuple[str, ...] = ()
    formulas: tuple[str, ...] = ()
    in_set: bool = False
    heldout_before: float = math.nan
    heldout_after: float = math.nan
    accepted: bool = False
    sure: bool = False

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> Searched:
        """The object that `document` describes, also after JSON, which has no NaN."""
        fields: dict[str, Any] = dict(document)
        for name in ("places", "over", "formulas"):
            fields[name] = tuple(fields[name])
        for name in ("heldout_before", "heldout_after"):
            fields[name] = math.nan if fields[name] is None else fields[name]
        return cls(**fields)


@dataclass(frozen=True)
class LearningOutcome:
    """The result of learning on the separate bench.

    Attributes
    ----------
    ended, rounds, added: as in `rigctl.learning.result.Learned`, with the rounds that were measured.
    left: the classes with more than one effect after the first campaign.
    probability, separation: predicted for the first designed round; None if none was carried out.
    winner, told, kept, gains, expected: its outcome, as in `rigctl.learning.result.RoundOutcome`.
    chances: for the first designed round, the probability that the hidden effect is distinguished from each
        rival.
    apart: those from which it is distinguished, if it is named.
    of_random: median worth of the records with which the design started; `of_first` that of its first one.
    sensor: that would distinguish what is left; `statement` says why it ended.
    """

    ended: str = ""
    rounds: int = 0
    added: tuple[str, ...] = ()
    left: tuple[tuple[str, ...], ...] = ()
    probability: float | None = None
    separation: float | None = None
    winner: str = ""
    told: bool = False
    kept: bool = True
    gains: Mapping[str, float] = field(default_factory=dict)
    expected: Mapping[str, float] = field(default_factory=dict)
    chances: Mapping[str, float] = field(default_factory=dict)
    apart: tuple[str, ...] = ()
    of_random: float | None = None
    of_first: float | None = None
    sensor: tuple[str, ...] = ()
    statement: str = ""

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> LearningOutcome:
        """The object that `document` describes, also after JSON; older ones have fewer fields."""
        classes = tuple(tuple(names) for names in document["left"])
        several = {name: tuple(document.get(name, ())) for name in ("added", "apart", "sensor")}
        return cls(**{**document, **several, "left": classes})


@dataclass(frozen=True)
class Improved:
    """The errors of a model of a real log, before and after what the diagnosis added.

    Attributes
    ----------
    added: the effects that were added, in order.
    r2: by channel, of the model as given on the log to which it was fitted.
    before, after: RMSE of a simulation of each unseen part, in the unit of the log's channel; NaN if the
        simulation fails.
    last: the verdict on the improved model.
    parameters: number of parameters of the improved model that were fitted.
    """

    added: tuple[str, ...] = ()
    r2: Mapping[str, float | None] = field(default_factory=dict)
    before: Mapping[str, float] = field(default_factory=dict)
    after: Mapping[str, float] = field(default_factory=dict)
    last: str = ""
    parameters: int = 0

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> Improved:
        """The object that `document` describes, also after JSON."""
        return cls(**{**document, "added": tuple(document["added"])})


@dataclass(frozen=True)
class TrialOutcome(Generic[AnyTrial]):
    """The outcome of one trial.

    Attributes
    ----------
    verdict: of the diagnosis; None if there was none.
    effects: the most probable set that it names.
    classes: effects that, by the answer, the data cannot distinguish.
    claims: its certain statements, for each of `effects`.
    all_of_it: nothing is left beside them, according to the answer.
    first: the effect at the top of its ranking.
    sizes, amplitudes: actual λ and amplitude (SI) of each hidden effect.
    rival_cosine, separation: the largest and the smallest of the hidden effects, see `similarity.Likeness`.
    beside: λ of each of several hidden effects beside the others; empty if unknown.
    beyond_laws: the same beyond the shape tolerance of the others' laws; empty if unknown.
    explained_by: what explains the misfit instead of an effect: "calibration".
    intervals: of parameters with known true values.
    exponents: of laws that it corrects, with the exponent fitted to noise-free readings.
    searched: the result of a search for a formula, if one was made.
    learnt: the result of learning, if the bench was measured again.
    improved: the errors before and after additions, of a real log.
    untested: why there was nothing to diagnose, e.g. that no amplitude has the wanted size.
    failure: the error, if any; such a trial counts against the tool.
    seconds: CPU time, s, without what was reused.
    """

    scenario: AnyTrial
    verdict: Verdict | None = None
    effects: tuple[str, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    claims: tuple[Claim, ...] = ()
    all_of_it: bool = True
    first: str | None = None
    sizes: tuple[float, ...] = ()
    amplitudes: tuple[float, ...] = ()
    rival_cosine: float | None = None
    separation: float | None = None
    beside: tuple[float, ...] = ()
    beyond_laws: tuple[float, ...] = ()
    explained_by: str = ""
    intervals: tuple[Interval, ...] = ()
    exponents: tuple[Interval, ...] = ()
    searched: Searched | None = None
    learnt: LearningOutcome | None = None
    improved: Improved | None = None
    untested: str = ""
    failure: str = ""
    seconds: float = 0.0

    @property
    def counts(self) -> bool:
        """True unless the scenario could not be made."""
        return not self.untested

    @property
    def accepted(self) -> bool:
        """True if the diagnosis names effects."""
        return self.verdict in ("missing_effect", "ambiguous") and bool(self.effects)

    def named_class(self, effect: str) -> frozenset[str]:
        """The class of effects that contains `effect`, among which the diagnosis does not decide."""
        return frozenset({effect}).union(*(group for group in self.classes if effect in group))

    @property
    def right(self) -> bool:
        """True if every effect that it names is hidden, or in one class with a hidden one."""
        truth = set(self.scenario.truth)
        return self.accepted and all(truth & self.named_class(effect) for effect in self.effects)

    @property
    def exact(self) -> bool:
        """True if it names as many effects as are hidden, and each hidden one or one of its class."""
        truth = self.scenario.truth
        complete = all(any(effect in self.named_class(named) for named in self.effects) for effect in truth)
        return self.right and complete and len(self.effects) == len(truth)

    def document(self) -> dict[str, Any]:
        """The outcome as plain data."""
        return {**asdict(self), "scenario": self.scenario.document()}

    @classmethod
    def read(
        cls, document: Mapping[str, Any], trial: Callable[[Mapping[str, Any]], AnyTrial]
    ) -> TrialOutcome[AnyTrial]:
        """The outcome that `document` describes, also after JSON; `trial` reads the trial."""
        fields = dict(document)
        for name in ("effects", "sizes", "amplitudes", "beside", "beyond_laws"):
            fields[name] = tuple(fields.get(name, ()))  # older results have no `beyond_laws`
        fields["scenario"] = trial(fields["scenario"])
        fields["classes"] = tuple(tuple(group) for group in fields["classes"])
        fields["claims"] = tuple(Claim(**claim) for claim in fields["claims"])
        for name in ("intervals", "exponents"):  # older results have no exponents
            fields[name] = tuple(Interval(**interval) for interval in fields.get(name, ()))
        searched = fields.get("searched")
        fields["searched"] = None if searched is None else Searched.read(searched)
        learning = fields.get("learnt")
        fields["learnt"] = None if learning is None else LearningOutcome.read(learning)
        improved = fields.get("improved")
        fields["improved"] = None if improved is None else Improved.read(improved)
        return cls(**fields)


#: of a campaign on the separate bench
Outcome: TypeAlias = TrialOutcome[Scenario]
