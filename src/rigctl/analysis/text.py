"""A diagnosis in sentences: the verdict, and the evidence for and against it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from rigctl.analysis.adequacy import chance_text, error_below
from rigctl.analysis.candidates import Candidate
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.cross_validation import CrossValidation
from rigctl.analysis.decision_levels import (
    ALIKE,
    ALPHA,
    BELOW_NOISE,
    LEAST_DIFFERENCE,
    LEAST_SEPARATION,
    ODDS,
    SEEN_IN_LIBRARY,
    SHAPE,
    SHAPE_TOLERANCE,
    TOLERANCE,
)
from rigctl.analysis.diagnosis_result import Diagnosis, Drift, FoundParameter, Ranked, Verdict
from rigctl.analysis.identity import only_constants, wanted_elsewhere
from rigctl.analysis.refit import RefittedSet
from rigctl.analysis.remainder import Remainder, share_text, strength
from rigctl.analysis.rivals import Differs, Rival
from rigctl.analysis.undecided import undecided_text
from rigctl.effects.declaration import Effect
from rigctl.effects.record_level import RECORD
from rigctl.units import parse_unit

#: an effect is reported as hidden in a parameter if less than this share of its signature is left
_HIDDEN = 0.3
#: a parameter that changes by less than this share was not biased
_MOVED = 0.02
#: least difference of cosines between phases that is reported
_UNLIKE = 0.15


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


def would_be_missing(exact: Diagnosis) -> str:
    """What is missing according to a diagnosis with exact sensors: ``valve_leakage would be missing``."""
    named = " and ".join(exact.effects)
    if exact.verdict is Verdict.MISSING_EFFECT:
        return f"{named} would be missing"
    if exact.verdict is Verdict.AMBIGUOUS:
        return f"{named} might be missing, or another effect"
    if exact.verdict is Verdict.ADEQUATE:
        return "nothing would be missing within the tolerance of its laws"
    if exact.verdict is Verdict.UNDECIDED:
        return "it is not decided whether anything is missing"
    return "the model would not agree, and nothing in the library would explain it"


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
    close = _each_once([rival for rival in rivals if not rival.separable])
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


def _each_once(rivals: Sequence[Rival]) -> list[Rival]:
    """Rivals, of which the two members of a replacing pair are mentioned once."""
    once: list[Rival] = []
    for one in rivals:
        if not any((other.name, other.beside) == (one.beside, one.name) for other in once):
            once.append(one)
    return once


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
    """What else it could be and where the two differ most, for an answer; `rival_text` has the evidence."""
    other = f"{rival.name} and {rival.beside} together" if rival.beside else rival.name
    text = f"{other} would look like {rival.member}"
    if rival.unusual:
        text += f" with its {rival.unusual}"
    text += _largest_difference(rival)
    return f"{text}, and these data {'' if rival.separable else 'do not '}tell them apart"


def rival_text(rival: Rival) -> str:
    """How similar the two are, where they differ, and whether these data distinguish them."""
    other = f"{rival.name} and {rival.beside} together" if rival.beside else rival.name
    text = f"{other} would look like {rival.member} (cos {rival.cos:.2f})"
    if rival.unusual:
        text += f" with its {rival.unusual}"
    if rival.differs is not None:
        text += _alike_text(rival.differs) + _largest_difference(rival)
    if rival.separable:
        return f"{text}, and these data tell them apart (d = {rival.separation:.1f})"
    return f"{text}, and these data do not tell them apart ({_lacking(rival)})"


def _largest_difference(rival: Rival) -> str:
    """The clause on where the two differ most; "" if they predict the same."""
    where = rival.differs
    if where is None:
        return ""
    most = f" at {where.condition}" if where.condition else ""
    return (
        f"; the two differ most in {where.channel}{' in ' if where.phase else ''}{where.phase}, by up to "
        f"{abs(where.largest):.2g} {where.unit}{most}"
    )


def _lacking(rival: Rival) -> str:
    """Which of the conditions for being distinguishable are not met."""
    parts = []
    if rival.separation < LEAST_SEPARATION:
        parts.append(f"d = {rival.separation:.2f}, at least {LEAST_SEPARATION} is needed")
    if rival.difference < LEAST_DIFFERENCE:
        parts.append(f"their mBIC differs by {rival.difference:.1f}, at least {LEAST_DIFFERENCE} is needed")
    if rival.nested:
        parts.append(
            f"{rival.member} with {rival.nested} is {rival.name}, and its fit is not significantly different"
        )
    if rival.both_leave:
        parts.append("both leave much more than the white noise, so that neither is excluded")
    if not parts:
        parts.append(
            f"they differ by {share_text(max(rival.share, 0.0))} of what it explains, and the shape of "
            f"either may account for that: at least {share_text(TOLERANCE**2)} is needed"
        )
    return "; ".join(parts)


def _alike_text(where: Differs) -> str:
    """In which phase the two are most similar, and in which least."""
    if len(where.alike) < 2 or where.alike[0][1] - where.alike[-1][1] < _UNLIKE:
        return ""
    (most, largest), (least, smallest) = where.alike[0], where.alike[-1]
    side = "not" if smallest < 0.5 else "less so"
    return f": in {most} ({largest:.2f}), {side} in {least} ({smallest:.2f})"


def evidence_for(
    candidate: Candidate,
    ranked: Ranked,
    check: CrossValidation | None,
    rivals: Sequence[Rival],
    *,
    several: bool,
) -> list[str]:
    """One sentence for each piece of evidence for or against an effect, one of `several` or the only one."""
    name = candidate.name
    lines = [_size(ranked, several=several)]
    if ranked.delta_bic < 0.0:
        odds = f"{LEAST_DIFFERENCE} is odds of {ODDS} to 1"
        lines.append(f"for {name}: mBIC falls by {-ranked.delta_bic:.1f} with it ({odds})")
    else:
        lines.append(f"against {name}: mBIC rises by {ranked.delta_bic:.1f} with it")
    if check is not None and check.possible:
        side = "for" if check.passed else "against"
        lines.append(
            f"{side} {name}: on conditions left out one at a time the normalised error changes from "
            f"{check.before:.4g} to {check.after:.4g} ({check.folds} folds, mean gain {check.mean:.1f} "
            f"± {check.error:.1f})"
        )
    if ranked.kappa < _HIDDEN and ranked.hidden_in:
        lines.append(
            f"against {name}: {_hidden_text(ranked.hidden_in)} imitates it to within "
            f"{100 * ranked.kappa:.0f} % of its size; the verdict rests on the remaining "
            f"{100 * ranked.kappa:.0f} %"
        )
    mine = [rival for rival in rivals if rival.member == name]
    each = sorted(_each_once(mine), key=lambda rival: rival.difference)
    lines += [f"against {name}: {rival_text(rival)}" for rival in each if not rival.separable]
    lines += [f"for {name}: {rival_text(rival)}" for rival in each if rival.separable and rival.cos > ALIKE][
        :1
    ]
    return lines


def _hidden_text(hidden_in: str) -> str:
    """The clause on unknowns that imitate an effect."""
    record_level = "variation from record to record (of settings, zeros, times and initial states)"
    return record_level if hidden_in == RECORD else f"the fitted {hidden_in}"


def _size(ranked: Ranked, *, several: bool) -> str:
    """Its size relative to the noise, and whether it is significant in the model as given."""
    p = ranked.score_p_value
    text = f"for {ranked.effect}: it stands out from the noise by {ranked.size:.1f} sigma"
    if p > ALPHA and several:
        return (
            f"{text}, but only together with the others: by itself its score is not significant (p = {p:.2g})"
        )
    if p > ALPHA:
        return f"{text}, but only at a finite size: from none, its score is not significant (p = {p:.2g})"
    return f"{text} ({chance_text(p)} for the largest score of the whole library)"


def drift_text(drifts: Sequence[Drift]) -> list[str]:
    """Fitted parameters that were biased by what was missing.

    Without a bias the two estimates differ by chance with variance ``|s₂² − s₁²|``, s being their standard
    deviations (J. A. Hausman, Econometrica 46 (1978) 1251); a change is reported if it exceeds twice the
    square root of that, and both s.
    """
    return [
        f"{one.parameter} moves from {one.before:.4g} to {one.after:.4g} {one.unit}: it had absorbed "
        "part of what was missing"
        for one in drifts
        if _moved(one)
    ]


def _moved(one: Drift) -> bool:
    """Whether a change is significant, and large enough to be reported.

    On a scale with an offset, such as degC, a relative change has no meaning.
    """
    change = abs(one.after - one.before)
    before, after = (std if math.isfinite(std) else 0.0 for std in (one.before_std, one.after_std))
    sure = max(2.0 * math.sqrt(abs(after**2 - before**2)), before, after)
    return change > sure and (parse_unit(one.unit).absolute_temperature or change > _MOVED * abs(one.before))


def _lower_case_start(text: str) -> str:
    """With a lower-case first letter, for use within a sentence."""
    return text[:1].lower() + text[1:] if text[1:2].islower() or text[:2] == "A " else text


def _capitalised(text: str) -> str:
    """With an upper-case first letter, unless the text begins with a name."""
    return text if "_" in text.partition(" ")[0] else text[:1].upper() + text[1:]
