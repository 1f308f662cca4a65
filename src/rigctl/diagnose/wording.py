"""A diagnosis in sentences: what it says, what speaks for it and what against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rigctl.compare.candidates import Candidate
from rigctl.compare.chance import chance_text
from rigctl.compare.result import ModelComparison
from rigctl.diagnose.folds import HeldOut
from rigctl.diagnose.result import Drift, FoundParameter, Ranked, Verdict
from rigctl.diagnose.rivals import Differs, Rival
from rigctl.effects.declaration import Effect

#: an effect is named as hidden in a parameter where that takes more of it
_HIDDEN = 0.3
#: a parameter that moves by less has not been biased
_MOVED = 0.02
_LEFT = 0.01
#: phases in which two effects are less alike by this are told
_UNLIKE = 0.15
#: an effect that is told apart is worth a word where its signature is more alike than this
_ALIKE = 0.5


def parameters_text(parameters: Mapping[str, FoundParameter]) -> str:
    """``conductance 4e-15 ± 1e-16 m^3``."""
    return ", ".join(f"{name} {one}" for name, one in parameters.items())


def effect_text(effect: Effect, parameters: Mapping[str, FoundParameter]) -> str:
    """What is seen, what it is, and how large."""
    seen = effect.looks_like.rstrip(".")
    return f"{seen}: {_begun_low(effect.summary.rstrip('.'))} ({effect.name}, {parameters_text(parameters)})"


def verdict_text(
    verdict: Verdict,
    before: ModelComparison,
    chosen: Sequence[tuple[Candidate, Ranked]],
    rivals: Sequence[Rival],
    left: float,
) -> str:
    """The statement of a verdict."""
    if verdict is Verdict.ADEQUATE:
        return before.statement
    described = ". ".join(effect_text(candidate.effect, ranked.parameters) for candidate, ranked in chosen)
    if verdict is Verdict.MISSING_EFFECT:
        text = described
        alike = [rival for rival in rivals if rival.cos > _ALIKE]
        if alike:
            text += f". {_begun_high(rival_text(min(alike, key=lambda rival: rival.difference)))}"
        if left > _LEFT:
            text += (
                f". A remainder of {100 * left:.0f} % of the misfit stays: its shape is not exactly this one"
            )
        return text
    if verdict is Verdict.AMBIGUOUS:
        text = f"Something is missing, and these data cannot tell which. Most probable: {described}"
        close = [rival for rival in rivals if not rival.told]
        return ". ".join([text, *(_begun_high(rival_text(rival)) for rival in close)])
    if chosen:
        return (
            "What is missing is more than one or two effects of the library, or not in it. The nearest is "
            f"this, but with it {100 * left:.0f} % of the misfit is left: {described}"
        )
    return "Something is missing that no effect of the library explains"


def rival_text(rival: Rival) -> str:
    """How like the two are, where they differ, and whether these data tell them apart."""
    text = f"{rival.name} would look like {rival.member} (cos {rival.cos:.2f})"
    where = rival.differs
    if where is not None:
        text += _alike_text(where)
        most = f" at {where.condition}" if where.condition else ""
        text += (
            f"; the two differ most in {where.channel}{' in ' if where.phase else ''}{where.phase}, by up to "
            f"{abs(where.largest):.2g} {where.unit}{most}"
        )
    if rival.told:
        return f"{text}, and these data tell them apart (d = {rival.separation:.1f})"
    return f"{text}, and these data do not tell them apart (d = {rival.separation:.1f}, 2.3 would do)"


def _alike_text(where: Differs) -> str:
    """In which phases the two are alike, and in which they are not."""
    if len(where.alike) < 2 or where.alike[0][1] - where.alike[-1][1] < _UNLIKE:
        return ""
    (most, largest), (least, smallest) = where.alike[0], where.alike[-1]
    side = "not" if smallest < 0.5 else "less so"
    return f": in {most} ({largest:.2f}), {side} in {least} ({smallest:.2f})"


def evidence_for(
    candidate: Candidate, ranked: Ranked, check: HeldOut | None, rivals: Sequence[Rival]
) -> list[str]:
    """A sentence for each thing that speaks for an effect or against it."""
    name = candidate.name
    found = [_size(ranked)]
    if ranked.delta_bic < 0.0:
        found.append(f"for {name}: mBIC falls by {-ranked.delta_bic:.1f} with it (9.2 is odds of 100 to 1)")
    else:
        found.append(f"against {name}: mBIC rises by {ranked.delta_bic:.1f} with it")
    if check is not None and check.folds >= 2:
        side = "for" if check.passed else "against"
        found.append(
            f"{side} {name}: on conditions left out one after the other the normalised error goes from "
            f"{check.before:.4g} to {check.after:.4g} ({check.folds} folds, mean gain {check.mean:.1f} "
            f"± {check.error:.1f})"
        )
    if ranked.kappa < _HIDDEN and ranked.hidden_in:
        found.append(
            f"against {name}: {100 * (1 - ranked.kappa):.0f} % of what it does the fitted {ranked.hidden_in} "
            f"can do too; the verdict rests on the other {100 * ranked.kappa:.0f} %"
        )
    own = sorted((rival for rival in rivals if rival.member == name), key=lambda rival: rival.difference)
    found += [f"against {name}: {rival_text(rival)}" for rival in own if not rival.told]
    found += [f"for {name}: {rival_text(rival)}" for rival in own if rival.told and rival.cos > _ALIKE][:1]
    return found


def _size(ranked: Ranked) -> str:
    """How far it stands out of the noise, and whether it did so in the model as it is."""
    p = ranked.score_p_value
    text = f"for {ranked.effect}: it stands out of the noise by {ranked.size:.1f} sigma"
    if p > 0.01:
        return f"{text}, but only beside the others: on the model as it is its score is nothing (p = {p:.2g})"
    return f"{text} ({chance_text(p)} for the largest of the whole library)"


def drift_text(found: Sequence[Drift]) -> list[str]:
    """Fitted parameters that were biased by what was missing."""
    return [
        f"{one.parameter} moves from {one.before:.4g} to {one.after:.4g} {one.unit}: it had taken over "
        "a part of what was missing"
        for one in found
        if one.before and abs(one.after / one.before - 1.0) > _MOVED
    ]


def _begun_low(text: str) -> str:
    """As the middle of a sentence."""
    return text[:1].lower() + text[1:] if text[1:2].islower() or text[:2] == "A " else text


def _begun_high(text: str) -> str:
    """As the beginning of a sentence, unless it begins with a name."""
    return text if "_" in text.partition(" ")[0] else text[:1].upper() + text[1:]
