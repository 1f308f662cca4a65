"""What a diagnosis said of one scenario, reduced to what the rates are made of."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Generic, Literal, Protocol, TypeAlias, TypeVar

from rigctl.validation.scenario import Scenario


class Trial(Protocol):
    """What is tried: a campaign that hides something, or nothing."""

    @property
    def name(self) -> str:
        """All of it in one line, unique among the trials of a tier."""

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of effects that are a right answer; none where nothing is hidden."""

    def document(self) -> dict[str, Any]:
        """The trial as plain data."""


AnyTrial = TypeVar("AnyTrial", bound=Trial)
Verdict: TypeAlias = Literal["adequate", "missing_effect", "ambiguous", "outside_library"]


@dataclass(frozen=True)
class Interval:
    """A 95 % interval of an effect's parameter and the value that the bench really has, SI."""

    effect: str
    parameter: str
    truth: float
    low: float
    high: float

    @property
    def covers(self) -> bool:
        """True when the truth lies in it."""
        return self.low <= self.truth <= self.high


@dataclass(frozen=True)
class Claim:
    """What a diagnosis says for sure of one effect that it names: its place, what drives it, its law."""

    effect: str
    place: bool
    driver: bool
    law: bool


@dataclass(frozen=True)
class Searched:
    """What a search for a formula found.

    Attributes
    ----------
    gate: why it looked, or did not.
    places: the first two, each with those at which a term does the same.
    over: the variables that the first one is over.
    formulas: the set, as ``slot: form of variable``.
    in_set: it holds what is planted, or what does the same to the readings.
    heldout_before, heldout_after: of the first formula, in units of the noise.
    accepted: the first formula predicts what it was not fitted to.
    sure: a place stands out of chance.
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
        """What `document` was made of, also after a way through JSON, which has no NaN."""
        fields: dict[str, Any] = dict(document)
        for name in ("places", "over", "formulas"):
            fields[name] = tuple(fields[name])
        for name in ("heldout_before", "heldout_after"):
            fields[name] = math.nan if fields[name] is None else fields[name]
        return cls(**fields)


@dataclass(frozen=True)
class Learnt:
    """What came of learning on the separate bench.

    Attributes
    ----------
    ended, rounds, added: as of `rigctl.learning.result.Learned`, with the rounds that were measured.
    left: the classes of more than one that the first campaign left.
    probability, separation: promised of the first designed round; None where none was carried out.
    winner, told, kept, gains, expected: what came of it, as of `rigctl.learning.result.CameOut`.
    chances: of the first designed round, the probability that what is hidden is told from each rival.
    apart: those that it is told from, where it is named.
    of_random: what the median of the records is worth that the design began with; `of_first` its first one.
    sensor: that would tell what is left apart; `statement` says why it ended.
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
    def read(cls, document: Mapping[str, Any]) -> Learnt:
        """What `document` was made of, also after a way through JSON; older ones have less in them."""
        left = tuple(tuple(names) for names in document["left"])
        several = {name: tuple(document.get(name, ())) for name in ("added", "apart", "sensor")}
        return cls(**{**document, **several, "left": left})


@dataclass(frozen=True)
class TrialOutcome(Generic[AnyTrial]):
    """What came of one trial.

    Attributes
    ----------
    verdict: of the diagnosis; None when there was none.
    effects: that it names: the most probable set.
    classes: effects that it says the data cannot tell apart.
    claims: what it says for sure, of each of `effects`.
    all_of_it: nothing is left beside them, as far as it says.
    first: the effect at the top of its ranking.
    sizes, amplitudes: λ and amplitude (SI) of each hidden effect, as they were made.
    rival_cosine, separation: of the hidden effects the largest and the smallest, see `likeness.Likeness`.
    beside: λ of each of several hidden effects beside the others: what those leave of it; empty where that is
        not known.
    intervals: of parameters whose truth is known.
    exponents: of laws that it corrects, with the exponent that readings without noise ask for.
    searched: what a search for a formula found, where one was made.
    learnt: what came of learning, where the bench was asked again.
    untested: why there was nothing to diagnose, e.g. that no amplitude has the size wanted.
    failure: what went wrong; such a trial counts against the tool.
    seconds: of processor time that it took.
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
    intervals: tuple[Interval, ...] = ()
    exponents: tuple[Interval, ...] = ()
    searched: Searched | None = None
    learnt: Learnt | None = None
    untested: str = ""
    failure: str = ""
    seconds: float = 0.0

    @property
    def counts(self) -> bool:
        """True unless the scenario could not be made."""
        return not self.untested

    @property
    def accepted(self) -> bool:
        """True when the diagnosis names effects."""
        return self.verdict in ("missing_effect", "ambiguous") and bool(self.effects)

    def named_class(self, effect: str) -> frozenset[str]:
        """The effects among which the diagnosis does not decide, `effect` among them."""
        return frozenset({effect}).union(*(group for group in self.classes if effect in group))

    @property
    def right(self) -> bool:
        """True when every effect it names is hidden, or is of one class with a hidden one."""
        truth = set(self.scenario.truth)
        return self.accepted and all(truth & self.named_class(effect) for effect in self.effects)

    @property
    def exact(self) -> bool:
        """True when it names as many effects as are hidden, and each hidden one or one of its class."""
        truth = self.scenario.truth
        found = all(any(effect in self.named_class(named) for named in self.effects) for effect in truth)
        return self.right and found and len(self.effects) == len(truth)

    def document(self) -> dict[str, Any]:
        """The outcome as plain data."""
        return {**asdict(self), "scenario": self.scenario.document()}

    @classmethod
    def read(
        cls, document: Mapping[str, Any], trial: Callable[[Mapping[str, Any]], AnyTrial]
    ) -> TrialOutcome[AnyTrial]:
        """The outcome that `document` made, also after a way through JSON; `trial` reads what was tried."""
        fields = dict(document)
        for name in ("effects", "sizes", "amplitudes", "beside"):
            fields[name] = tuple(fields[name])
        fields["scenario"] = trial(fields["scenario"])
        fields["classes"] = tuple(tuple(group) for group in fields["classes"])
        fields["claims"] = tuple(Claim(**claim) for claim in fields["claims"])
        for name in ("intervals", "exponents"):  # what was kept before there were exponents has none
            fields[name] = tuple(Interval(**interval) for interval in fields.get(name, ()))
        searched = fields.get("searched")
        fields["searched"] = None if searched is None else Searched.read(searched)
        learnt = fields.get("learnt")
        fields["learnt"] = None if learnt is None else Learnt.read(learnt)
        return cls(**fields)


#: of a campaign on the separate bench
Outcome: TypeAlias = TrialOutcome[Scenario]
