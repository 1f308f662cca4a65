"""A diagnosis in sentences: what it says, what speaks for it and what against."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.compare.candidates import Candidate
from rigctl.compare.result import ModelComparison
from rigctl.diagnose.folds import HeldOut
from rigctl.diagnose.result import Drift, FoundParameter, Ranked, Verdict


def parameters_text(parameters: dict[str, FoundParameter] | object) -> str:
    """``conductance = 4e-15 m^3 ± 1e-16``."""
    if not isinstance(parameters, dict):
        return ""
    return ", ".join(
        f"{name} = {one.value:.3g} {'' if one.unit == '1' else one.unit + ' '}± {one.std:.1g}"
        for name, one in parameters.items()
    )


def effect_text(candidate: Candidate, ranked: Ranked) -> str:
    """What is seen, what it is, and how large."""
    effect = candidate.effect
    seen = effect.looks_like.rstrip(".")
    what = effect.summary.rstrip(".")
    return f"{seen}. {what} ({effect.name}, {parameters_text(dict(ranked.parameters))})"


def verdict_text(
    verdict: Verdict,
    before: ModelComparison,
    chosen: Sequence[tuple[Candidate, Ranked]],
    rivals: Sequence[tuple[str, str, float, float]],
    left: float,
) -> str:
    """The statement of a verdict; `rivals` are (member, rival, cosine, separation)."""
    if verdict is Verdict.ADEQUATE:
        return before.statement
    described = "; and: ".join(effect_text(candidate, ranked) for candidate, ranked in chosen)
    if verdict is Verdict.MISSING_EFFECT:
        text = described
        if rivals:
            member, name, cos, d = max(rivals, key=lambda rival: rival[2])
            alike = f"The most alike is {name} (cos {cos:.2f})"
            text += f". {alike}, which these data tell from {member} (d = {d:.1f})"
        if left > 0.01:
            text += (
                f". A remainder of {100 * left:.0f} % of the misfit stays: its shape is not exactly this one"
            )
        return text
    if verdict is Verdict.AMBIGUOUS:
        names = list(dict.fromkeys(name for _, name, _, _ in rivals))
        text = f"Something is missing, and these data cannot tell which. Most probable: {described}"
        return f"{text}. As good: {', '.join(names)}" if names else text
    if chosen:
        return (
            f"What is missing is not in the library. The nearest is {described}, but the model with it still "
            f"does not agree with the measurements ({100 * left:.0f} % of the misfit is left)"
        )
    return "Something is missing that no effect of the library explains"


def evidence_for(
    candidate: Candidate,
    ranked: Ranked,
    check: HeldOut | None,
    rivals: Sequence[tuple[str, str, float, float]],
) -> list[str]:
    """A sentence for each thing that speaks for an effect or against it."""
    name = candidate.name
    p = ranked.score_p_value
    chance = "p < 1e-6" if p < 1e-6 else f"p = {p:.2g}"
    found = [
        f"for {name}: its signature stands out of the noise by {ranked.size:.1f} sigma "
        f"({chance} over the whole library)"
    ]
    if ranked.delta_bic < 0.0:
        found.append(f"for {name}: mBIC falls by {-ranked.delta_bic:.1f} with it")
    else:
        found.append(f"against {name}: mBIC rises by {ranked.delta_bic:.1f} with it")
    if check is not None and check.folds >= 2:
        side = "for" if check.passed else "against"
        found.append(
            f"{side} {name}: on conditions left out of the fit the normalised error goes from "
            f"{check.before:.4g} to {check.after:.4g} ({check.folds} folds, mean gain {check.mean:.1f} "
            f"± {check.error:.1f})"
        )
    if ranked.kappa < 0.3 and ranked.hidden_in:
        found.append(
            f"against {name}: {100 * (1 - ranked.kappa):.0f} % of its signature can be taken over by "
            f"{ranked.hidden_in}; the verdict leans on that parameter's shape"
        )
    for member, rival, cos, d in rivals:
        if member == name:
            found.append(f"against {name}: {rival} would look alike (cos {cos:.2f}, separation d = {d:.1f})")
    return found


def drift_text(found: Sequence[Drift]) -> list[str]:
    """Fitted parameters that were biased by what was missing."""
    return [
        f"{one.parameter} moves from {one.before:.4g} to {one.after:.4g} {one.unit}: it had taken over "
        "a part of what was missing"
        for one in found
        if one.before and abs(one.after / one.before - 1.0) > 0.02
    ]
