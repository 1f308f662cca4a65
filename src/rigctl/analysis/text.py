"""The verdict of a diagnosis in sentences."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from rigctl.analysis.agreement.adequacy import error_below
from rigctl.analysis.agreement.undecided import undecided_text
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import (
    ALIKE,
    BELOW_NOISE,
    SEEN_IN_LIBRARY,
    SHAPE,
    SHAPE_TOLERANCE,
)
from rigctl.analysis.diagnosis_result import FoundParameter, Ranked, Verdict
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.search.identity import only_constants, wanted_elsewhere
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.remainder import Remainder, share_text, strength
from rigctl.analysis.search.rivals import Rival, each_once
from rigctl.effects.declaration import Effect


def parameters_text(parameters: Mapping[str, FoundParameter]) -> str:
    """``conductance 4e-15 ± 1e-16 m^3``."""
    return ", ".join(f"{name} {one}" for name, one in parameters.items())


def effect_text(effect: Effect, parameters: Mapping[str, FoundParameter]) -> str:
    """The symptom, the effect, and its parameters, as one clause."""
    symptom, summary = effect.looks_like.rstrip("."), effect.summary.rstrip(".")
    text = f"{symptom}: {_lower_case_start(summary)}" if symptom else summary
    return f"{text} ({effect.name}, {parameters_text(parameters)})"


def in_words(effect: Effect) -> str:
    """The effect as a sentence of physics, with its name in brackets."""
    return f"{effect.summary.rstrip('.')} ({effect.name})"


@dataclass(frozen=True)
class Statement:
    """A verdict in words.

    Attributes
    ----------
    opening: what is missing, by name, and what is uncertain about it.
    text: the same with a description of the effects, and what they leave.
    """

    opening: str
    text: str


def verdict_text(
    verdict: Verdict,
    before: ModelComparison,
    chosen: Sequence[tuple[Candidate, Ranked]],
    rivals: Sequence[Rival],
    remaining: Remainder | None,
    checks: Mapping[str, CrossValidation | None],
    visible: Ranked | None = None,
    against: Sequence[str] = (),
    doubt: str = "",
    allowed: float = SHAPE,
) -> Statement:
    """The statement of a verdict.

    Parameters
    ----------
    remaining: what the best set leaves.
    checks: cross-validation of each member of the best set.
    visible: the effect that is visible although no set improves mBIC.
    against: why the best set may not be what is missing, besides rivals; see `against_identity`.
    doubt: why these data cannot tell whether anything is missing at all; see `whether_at_all`.
    allowed: the largest share of the misfit that the right set may leave.
    """
    if verdict is Verdict.ADEQUATE:
        return Statement(before.statement, before.statement)
    if verdict is Verdict.UNDECIDED:
        text = before.statement if before.adequacy.below_noise else _undecided(before)
        return Statement(text, text)
    names = " and ".join(candidate.effect.name for candidate, _ in chosen)
    described = ". ".join(effect_text(candidate.effect, ranked.parameters) for candidate, ranked in chosen)
    if verdict is Verdict.OUTSIDE_LIBRARY and not described:
        opening = _unnamed_text(visible, doubt)
        return Statement(opening, opening)
    if verdict is Verdict.OUTSIDE_LIBRARY:
        too_much = remaining is not None and remaining.share > allowed
        left = remaining if too_much or not failed_checks(checks) else None
        several = len(chosen) > 1
        opening, referring = (
            _outside_text(nearest, left, checks, doubt, several=several)
            for nearest in (names, "these" if several and left is not None else "this")
        )
        return Statement(opening, f"{referring}: {described}")
    close = each_once([rival for rival in rivals if not rival.separable])
    if verdict is Verdict.MISSING_EFFECT:
        opening, text = f"{names} is missing", described
        alike = [rival for rival in rivals if rival.cos > ALIKE]
        if alike:
            text += f". {_capitalised(rival_sentence(min(alike, key=lambda rival: rival.difference)))}"
    elif close:
        opening = "Something is missing, and these data cannot tell which effect it is"
        text = ". ".join(
            [
                f"{opening}. Most probable: {described}",
                *(_capitalised(one) for one in (*map(rival_sentence, close), *against)),
            ]
        )
    else:
        opening, text = _doubtful_text(names, against), f"{_doubtful_text('this', against)}: {described}"
    if remaining is not None:
        text += f". That is not all: {remaining.statement}"
    return Statement(opening, text)


def _undecided(before: ModelComparison) -> str:
    """Slow noise or a missing effect, as the model itself leaves it."""
    if before.adequacy.unusable:
        return before.statement
    return undecided_text(before.fit, before.name, before.adequacy.unproven)


def whether_at_all(before: ModelComparison) -> str:
    """Why a misfit that no effect explains need not mean that something is missing; "" if it does.

    An error below `BELOW_NOISE` ends the search before it starts. An error merely within the noise counts
    against the model only if an effect explains it.
    """
    guessed = [channel.name for channel in before.fit.problem.noise.channels if channel.guessed]
    if guessed:
        return f"these data do not determine the noise of {', '.join(guessed)}"
    if error_below(before.fit, BELOW_NOISE):
        return "the error of every channel is below its noise, so the noise must be smaller than assumed"
    if error_below(before.fit, 1.0):
        return "the error of every channel is within its noise"
    return ""


def _opening_text(doubt: str) -> str:
    """Whether something is missing."""
    if not doubt:
        return "Something is missing"
    return f"A test rejects the model, but {doubt}: these data cannot tell whether something is missing"


def _unnamed_text(visible: Ranked | None, doubt: str) -> str:
    """Something is missing, and no set improves mBIC."""
    opening = _opening_text(doubt)
    if visible is not None:
        return (
            f"{opening}, but the data show too little of it to identify it: "
            f"{visible.effect} explains more of it than any other effect, but {strength(visible.size)} is "
            "not enough to name it"
        )
    if doubt:
        return f"{opening}, and no effect of the library explains it"
    return "Something is missing that no effect of the library explains"


def _outside_text(
    nearest: str,
    remaining: Remainder | None,
    checks: Mapping[str, CrossValidation | None],
    doubt: str,
    *,
    several: bool,
) -> str:
    """The nearest set, and why it is not named: for what it leaves, or else for what it does not predict."""
    opening = _opening_text(doubt)
    if remaining is None:
        return (
            (f"{opening}. It would be" if doubt else "What is missing is")
            + " more than two effects of the library, or one that is not in it. The nearest "
            f"is {nearest}, but {_failed_text(checks)}"
        )
    share = share_text(remaining.share)
    if several:
        return (
            f"{opening}. The nearest in the library are {nearest}, but they leave {share} of the misfit: "
            "their laws may have different shapes, something else may be missing as well, or they only "
            "resemble what is missing"
        )
    return (
        f"{opening}. The nearest in the library is {nearest}, but it leaves {share} of the misfit: its law "
        "may have a different shape, something else may be missing as well, or it only resembles what is "
        "missing"
    )


def _doubtful_text(nearest: str, against: Sequence[str]) -> str:
    """The most probable set, and why it is uncertain although no other explains as much."""
    return (
        f"Something is missing. No other effect of the library explains it as well as {nearest}, but "
        f"{', and '.join(against)}"
    )


def against_identity(
    best: RefittedSet,
    checks: Mapping[str, CrossValidation | None],
    remaining: Remainder | None,
    explained: float = math.inf,
    *,
    sizes: bool = True,
    certain: Collection[str] = (),
) -> list[str]:
    """Why the best set may not be what is missing, apart from its rivals; empty without such evidence.

    Reasons are: a parameter outside its usual range; an undetermined size; a failed cross-validation; noise
    that differs from what the tests assume; a remainder of several effects, which together may imitate one
    that is not in the library; a remainder of a single effect that is too small for another shape of its law
    to be visible.

    Parameters
    ----------
    explained: the reduction of χ² by the set, including that by the scatter of its effect's size.
    sizes: whether a parameter outside its usual range is a reason.
    certain: members of which something is certain all the same.
    """
    reasons = [f"{name} fits only with its {text}" for name, text in best.unusual.items()] if sizes else []
    reasons += [
        f"these data do not determine the size of {name}: its 95 % interval includes no effect at all"
        for name in best.undetermined
    ]
    failed = _failed_text(checks)
    reasons += [failed] if failed else []
    if remaining is not None and remaining.below_noise:
        reasons.append(
            "with it the error is below the noise, yet a test rejects: the noise of these readings differs "
            "from the assumed one"
        )
    if remaining is not None and len(best.candidates) > 1:
        reasons.append(_leaves_something([one.effect for one in best.candidates], remaining, certain))
    shape = SHAPE_TOLERANCE * math.sqrt(max(explained, 0.0))
    if remaining is not None and len(best.candidates) == 1 and shape < SEEN_IN_LIBRARY < remaining.size:
        reasons.append(
            f"what it leaves, {remaining.amount}, is more than a different shape of so small an effect "
            "accounts for"
        )
    return reasons


def _leaves_something(effects: Sequence[Effect], remaining: Remainder, certain: Collection[str]) -> str:
    """Why several effects that leave something may not be what is missing."""
    doubtful = [one.name for one in effects if one.name not in certain]
    if certain and doubtful:
        return (
            f"{' and '.join(doubtful)} may only resemble what is missing besides {' and '.join(certain)}: "
            f"together they leave {remaining.amount} that no other shape of their laws explains"
        )
    if wanted_elsewhere(effects, remaining.slot):
        return f"what they leave points to a term at {remaining.slot}, where none of them acts"
    if only_constants(effects):
        return (
            "none of them depends on a state or an input, yet a misfit is left: together they may imitate a "
            "term that varies"
        )
    return (
        f"together they leave {remaining.amount} that no other shape of their laws explains, and may "
        "imitate an effect that is not in the library"
    )


def failed_checks(checks: Mapping[str, CrossValidation | None]) -> tuple[str, ...]:
    """The effects that failed cross-validation: they do not predict data outside their fit."""
    return tuple(name for name, one in checks.items() if one is not None and one.possible and not one.passed)


def _failed_text(checks: Mapping[str, CrossValidation | None]) -> str:
    """Which effects failed cross-validation; "" for none."""
    failed = failed_checks(checks)
    if not failed:
        return ""
    does = "does not predict data that it was" if len(failed) == 1 else "do not predict data that they were"
    return f"{' and '.join(failed)} {does} not fitted to"


def rival_sentence(rival: Rival) -> str:
    """What else it could be and where the two differ most; `rigctl.answers.evidence` has all of it."""
    other = f"{rival.name} and {rival.beside} together" if rival.beside else rival.name
    text = f"{other} would look like {rival.member}"
    if rival.unusual:
        text += f" with its {rival.unusual}"
    text += largest_difference(rival)
    return f"{text}, and these data {'' if rival.separable else 'do not '}tell them apart"


def largest_difference(rival: Rival) -> str:
    """The clause on where the two differ most; "" if they predict the same."""
    where = rival.differs
    if where is None:
        return ""
    most = f" at {where.condition}" if where.condition else ""
    return (
        f"; the two differ most in {where.channel}{' in ' if where.phase else ''}{where.phase}, by up to "
        f"{abs(where.largest):.2g} {where.unit}{most}"
    )


def _lower_case_start(text: str) -> str:
    """With a lower-case first letter, for use within a sentence."""
    return text[:1].lower() + text[1:] if text[1:2].islower() or text[:2] == "A " else text


def _capitalised(text: str) -> str:
    """With an upper-case first letter, unless the text begins with a name."""
    return text if "_" in text.partition(" ")[0] else text[:1].upper() + text[1:]
