"""What a diagnosis concludes, as values: which effects, what is uncertain about them, and what they leave.

In: the verdict's outcome, the best set, its rivals and what it leaves. Out: a `Conclusion`. The verdict alone
does not say it: the same one is reached in several ways, each of which is a type here, so that whoever words
it (`rigctl.answers.findings.verdict`) needs no number again. Nothing here decides a verdict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from rigctl.analysis.agreement.adequacy import error_below
from rigctl.analysis.decision_levels import ALIKE, BELOW_NOISE, SHAPE
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.search.reasons import Reason, failed_checks
from rigctl.analysis.search.remainder import Remainder
from rigctl.analysis.search.rivals import Rival, each_once
from rigctl.effects.declaration import Effect

if TYPE_CHECKING:
    from rigctl.analysis.comparison_result import ModelComparison
    from rigctl.analysis.diagnosis_result import FoundParameter, Ranked

#: an effect with its fitted parameters
Member: TypeAlias = "tuple[Effect, Mapping[str, FoundParameter]]"


@dataclass(frozen=True)
class Doubt:
    """Why a misfit that no effect explains need not mean that something is missing.

    Attributes
    ----------
    reason: the noise of `channels` is only guessed; every error is below its noise, so that this must be
        smaller than assumed; every error is merely within its noise; or the model agrees beyond a bound.
    values: for a bound, the parameters with the values and units that they had beyond it.
    """

    reason: Literal["guessed_noise", "below_noise", "within_noise", "beyond_bounds"]
    channels: tuple[str, ...] = ()
    values: tuple[tuple[str, float, str], ...] = ()


@dataclass(frozen=True)
class AsCompared:
    """The comparison has said it: the model agrees, a sensor is wrong, or it is not decided."""


@dataclass(frozen=True)
class WithinTolerance:
    """The misfit is within the shape tolerance of the laws of effects that the model has."""

    laws: tuple[str, ...]
    p_value: float


@dataclass(frozen=True)
class MostlyWithinTolerance:
    """Most of the misfit is: such deviations explain all but the share `beyond` of what `nearest` does."""

    laws: tuple[str, ...]
    nearest: tuple[str, ...]
    beyond: float


@dataclass(frozen=True)
class NotProven:
    """Something is missing, whatever the noise is, and no effect proves itself."""


@dataclass(frozen=True)
class NothingNamed:
    """Something is missing, and no set improves mBIC; `visible` is the effect that is seen all the same."""

    visible: Ranked | None


@dataclass(frozen=True)
class Nearest:
    """A set that is not named for what it leaves, or for what its `failed` members do not predict."""

    members: tuple[Member, ...]
    left: Remainder | None
    failed: tuple[str, ...]


@dataclass(frozen=True)
class Missing:
    """A set of effects that is missing; `alike` is the rival that resembles a member most."""

    members: tuple[Member, ...]
    alike: Rival | None
    left: Remainder | None


@dataclass(frozen=True)
class OneOfSeveral:
    """A set of effects that these data do not distinguish from `rivals`."""

    members: tuple[Member, ...]
    rivals: tuple[Rival, ...]
    against: tuple[Reason, ...]
    left: Remainder | None


@dataclass(frozen=True)
class Doubtful:
    """The most probable set, with what is against it although no other explains as much."""

    members: tuple[Member, ...]
    against: tuple[Reason, ...]
    left: Remainder | None


@dataclass(frozen=True)
class OneOfTable:
    """For a table, the single effects that explain its `values` equally well; None: without parameters."""

    effects: tuple[tuple[Effect, Mapping[str, FoundParameter] | None], ...]
    values: int


Conclusion: TypeAlias = (
    AsCompared
    | WithinTolerance
    | MostlyWithinTolerance
    | NotProven
    | NothingNamed
    | Nearest
    | Missing
    | OneOfSeveral
    | Doubtful
    | OneOfTable
)

Outcome: TypeAlias = Literal["missing", "ambiguous", "outside"]


def conclude(
    outcome: Outcome,
    chosen: Sequence[tuple[Candidate, Ranked]],
    rivals: Sequence[Rival],
    remaining: Remainder | None,
    checks: Mapping[str, CrossValidation | None],
    visible: Ranked | None = None,
    against: Sequence[Reason] = (),
    allowed: float = SHAPE,
) -> Conclusion:
    """What is concluded where something is missing.

    Parameters
    ----------
    remaining: what the best set leaves.
    checks: cross-validation of each member of the best set.
    visible: the effect that is visible although no set improves mBIC.
    against: why the best set may not be what is missing, besides rivals.
    allowed: the largest share of the misfit that the right set may leave.
    """
    members = tuple((candidate.effect, ranked.parameters) for candidate, ranked in chosen)
    if outcome == "outside":
        if not members:
            return NothingNamed(visible)
        too_much = remaining is not None and remaining.share > allowed
        failed = failed_checks(checks)
        return Nearest(members, remaining if too_much or not failed else None, failed)
    if outcome == "missing":
        alike = [rival for rival in rivals if rival.cos > ALIKE]
        return Missing(members, min(alike, key=lambda rival: rival.difference, default=None), remaining)
    close = tuple(each_once([rival for rival in rivals if not rival.separable]))
    if close:
        return OneOfSeveral(members, close, tuple(against), remaining)
    return Doubtful(members, tuple(against), remaining)


def whether_at_all(before: ModelComparison) -> Doubt | None:
    """Why a misfit that no effect explains need not mean that something is missing; None if it does.

    An error below `BELOW_NOISE` ends the search before it starts. An error merely within the noise counts
    against the model only if an effect explains it.
    """
    guessed = tuple(channel.name for channel in before.fit.problem.noise.channels if channel.guessed)
    if guessed:
        return Doubt("guessed_noise", guessed)
    if error_below(before.fit, BELOW_NOISE):
        return Doubt("below_noise")
    return Doubt("within_noise") if error_below(before.fit, 1.0) else None
