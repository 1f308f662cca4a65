"""Why a set of effects may not be what is missing, besides its rivals: each reason is a type with its facts.

In: the best set, its cross-validations and what it leaves. Out: `Reason`s, of which any makes a verdict at
most `ambiguous`. `rigctl.answers.findings.reasons` words them.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from rigctl.analysis.decision_levels import SEEN_IN_LIBRARY, SHAPE_TOLERANCE
from rigctl.analysis.laws.answer import LawAnswer
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.linear.size_scatter import SizeScatter
from rigctl.analysis.search.identity import only_constants, wanted_elsewhere
from rigctl.analysis.search.own_scale import ErrorLeft, TooLargeForSensor
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.remainder import Remainder
from rigctl.effects.declaration import Effect
from rigctl.foreign.program import Program
from rigctl.model.fit.reached_bounds import ReachedBound


@dataclass(frozen=True)
class UnusualSize:
    """An effect that fits only with parameters outside their usual range; `parameters` names these."""

    effect: str
    parameters: str


@dataclass(frozen=True)
class UndeterminedSize:
    """An effect whose interval includes no effect at all."""

    effect: str


@dataclass(frozen=True)
class NotPredicted:
    """Effects that failed cross-validation: they do not predict data that they were not fitted to."""

    effects: tuple[str, ...]


@dataclass(frozen=True)
class OtherNoise:
    """With the set the error is below the noise, yet a test rejects: the noise is not the assumed one."""


@dataclass(frozen=True)
class MayResemble:
    """Some members may only resemble what is missing besides those that are certain."""

    doubtful: tuple[str, ...]
    certain: tuple[str, ...]
    left: Remainder


@dataclass(frozen=True)
class WantedElsewhere:
    """What several effects leave is at a slot where none of them acts."""

    slot: str


@dataclass(frozen=True)
class OnlyConstants:
    """None of several effects depends on a state or an input, yet a misfit is left."""


@dataclass(frozen=True)
class MayImitate:
    """What several effects leave fits no other shape of their laws."""

    left: Remainder


@dataclass(frozen=True)
class TooMuchLeft:
    """A single effect that is too small for another shape of its law to account for what it leaves."""

    left: Remainder


@dataclass(frozen=True)
class OnlyEdgesSearched:
    """A program computes the model: an effect at its edges, which are its inputs, outputs and parameters, may
    describe another cause inside.

    Attributes
    ----------
    program: its name; `noun` what it is: "the FMU".
    why: nothing is looked for inside it, in a clause; "" if that needs no reason.
    """

    program: str
    noun: str
    why: str

    @classmethod
    def of(cls, program: Program) -> OnlyEdgesSearched:
        """Of a model that `program` computes."""
        return cls(program.name, program.noun, program.why)


#: a reason against a set; the last ones are found by other modules, whose results say what there is to say
Reason: TypeAlias = (
    UnusualSize
    | UndeterminedSize
    | NotPredicted
    | OtherNoise
    | MayResemble
    | WantedElsewhere
    | OnlyConstants
    | MayImitate
    | TooMuchLeft
    | OnlyEdgesSearched
    | ErrorLeft
    | TooLargeForSensor
    | ReachedBound
    | LawAnswer
    | SizeScatter
)


def reasons_against(
    best: RefittedSet,
    checks: Mapping[str, CrossValidation | None],
    remaining: Remainder | None,
    explained: float = math.inf,
    *,
    sizes: bool = True,
    certain: Collection[str] = (),
) -> list[Reason]:
    """Why the best set may not be what is missing, apart from its rivals; empty without such evidence.

    Parameters
    ----------
    explained: the reduction of χ² by the set, including that by the scatter of its effect's size.
    sizes: whether a parameter outside its usual range is a reason.
    certain: members of which something is certain all the same.
    """
    reasons: list[Reason] = [UnusualSize(*one) for one in best.unusual.items()] if sizes else []
    reasons += [UndeterminedSize(name) for name in best.undetermined]
    failed = failed_checks(checks)
    reasons += [NotPredicted(failed)] if failed else []
    if remaining is None:
        return reasons
    if remaining.below_noise:
        reasons.append(OtherNoise())
    if len(best.candidates) > 1:
        reasons.append(_of_several([one.effect for one in best.candidates], remaining, certain))
    shape = SHAPE_TOLERANCE * math.sqrt(max(explained, 0.0))
    if len(best.candidates) == 1 and shape < SEEN_IN_LIBRARY < remaining.size:
        reasons.append(TooMuchLeft(remaining))
    return reasons


def _of_several(effects: Sequence[Effect], remaining: Remainder, certain: Collection[str]) -> Reason:
    """Why several effects that leave something may not be what is missing."""
    doubtful = tuple(one.name for one in effects if one.name not in certain)
    if certain and doubtful:
        return MayResemble(doubtful, tuple(certain), remaining)
    if wanted_elsewhere(effects, remaining.slot):
        return WantedElsewhere(remaining.slot)
    return OnlyConstants() if only_constants(effects) else MayImitate(remaining)


def failed_checks(checks: Mapping[str, CrossValidation | None]) -> tuple[str, ...]:
    """The effects that failed cross-validation: they do not predict data outside their fit."""
    return tuple(name for name, one in checks.items() if one is not None and one.possible and not one.passed)
