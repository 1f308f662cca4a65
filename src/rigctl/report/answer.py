"""The result of a comparison, a diagnosis or a search, for a reader who has a minute.

One title, one plain sentence, and the next questions: how large, how certain, how the error changed, what is
left. The page and the terminal show the same; the evidence follows in technical terms.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from rigctl.analysis.adequacy import chance_text
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.diagnosis_result import Diagnosis, FoundParameter, Ranked, Verdict
from rigctl.analysis.improve import Ended, Improvement
from rigctl.analysis.remainder import share_text
from rigctl.learning import result as learning
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.planning.outline import clock_time
from rigctl.report.everyday import everyday
from rigctl.report.numbers import plural
from rigctl.report.systematic import ChannelFall, falls, left_of, left_of_diagnosis
from rigctl.units import parse_unit

Tone = Literal["good", "warn", "bad"]

_TONES: dict[Verdict, Tone] = {
    Verdict.ADEQUATE: "good",
    Verdict.MISSING_EFFECT: "warn",
    Verdict.AMBIGUOUS: "warn",
    Verdict.OUTSIDE_LIBRARY: "bad",
}
#: as `chance_text` has it
_CHANCE = re.compile(r" \(p [<=] [0-9.e+-]+\)")
#: relative change of an error from which it counts as changed
_CHANGED = 0.02
#: effects whose size is stated
_MOST_SIZES = 2


@dataclass(frozen=True)
class Answer:
    """The answer alone.

    Attributes
    ----------
    tone: good if nothing is wrong, warn if something is missing or open, bad if the model fails.
    title: the verdict in a few words.
    sentence: the verdict in a plain sentence, without a full stop.
    facts: headings and texts, the most important first.
    """

    tone: Tone
    title: str
    sentence: str
    facts: tuple[tuple[str, str], ...]


def comparison_answer(model: ModelComparison) -> Answer:
    """How well one model agrees, and where it fails most."""
    facts = [("error", _error_text(falls([model.fit], left_of(model))))]
    if not model.adequate:
        facts += [("mostly at", _most(model)), ("wanted", _wanted(model))]
    facts.append(("held out", _held_out([model.fit])))
    below = model.adequacy.below_noise
    return Answer(
        "warn" if below else "good" if model.adequate else "bad",
        "Cannot tell" if below else "Agrees" if model.adequate else "Does not agree",
        model.statement,
        _said(facts),
    )


def models_answer(models: Sequence[ModelComparison]) -> Answer:
    """The answer for the last of several models, with the change of the error since the first."""
    last = comparison_answer(models[-1])
    if len(models) == 1:
        return last
    fits = [model.fit for model in models]
    facts = [("error", _error_text(falls(fits, left_of(models[-1])))), ("held out", _held_out(fits))]
    facts += [(head, text) for head, text in last.facts if head not in ("error", "held out")]
    return Answer(last.tone, last.title, last.sentence, _said(facts))


def plain_statement(model: ModelComparison) -> str:
    """A comparison's statement without its p-value."""
    return without_chance(model.statement)


def without_chance(text: str) -> str:
    """A sentence without its ``(p = 0.53)``."""
    return _CHANCE.sub("", text)


def diagnosis_answer(found: Diagnosis) -> Answer:
    """What is missing, its size, how certain that is, its effect on the error, and what is left."""
    if found.verdict is Verdict.ADEQUATE and not found.doubt:
        facts = [("error", _error_text(falls([found.before.fit], left_of(found.before))))]
    else:
        facts = [
            (_size_head(found), _sizes(found)),
            ("how sure", _sureness(found)),
            ("error", _error_text(falls([found.before.fit, found.best.fit], left_of_diagnosis(found)))),
            ("left", _left(found)),
        ]
    laws = [one.statement for one in found.laws if one.differs]
    facts.append(("its law", laws[0] if laws else ""))
    tone: Tone = "warn" if found.doubt else _TONES[found.verdict]
    return Answer(tone, found.title, _sentence(found), _said(facts))


def improvement_answer(found: Improvement) -> Answer:
    """What was added, how the error changed, and what the current model still lacks."""
    text = found.statement
    fits = [*([found.first.before.fit] if found.steps else []), found.last.before.fit]
    facts = [
        *(
            (f"version {step.version.number}", _added(found.steps[number].diagnosis, step.effects))
            for number, step in enumerate(found.steps)
        ),
        ("error", _error_text(falls(fits, left_of(found.last.before)))),
        *(("no fit saw", one.sentences[0]) for one in found.unseen),
    ]
    if found.ended is not Ended.ADEQUATE:
        facts += [("now", f"{found.last.title}: {_sentence(found.last)}")]
    tone: Tone = "good" if found.ended is Ended.ADEQUATE else "warn"
    return Answer(tone, "What was added", text[0].upper() + text[1:], _said(facts))


# --- a learning ---------------------------------------------------------------------------------------------


def learning_answer(
    found: learning.Learned, fits: Sequence[FitResult] = (), left: Mapping[str, float] | None = None
) -> Answer:
    """How a learning ended, what it added, how the error changed, and whether predictions came true.

    Parameters
    ----------
    fits: of the original and the current model, on all measurements; without them the error is not stated.
    left: of the last of them, as of `systematic.falls`.
    """
    good = found.ended is learning.Ended.ADEQUATE
    promises = [f"round {one.number}: {one.came_out.statement}" for one in found.rounds if one.came_out]
    facts = [
        ("added", ", ".join(f"{name} (version {v})" for one in found.rounds for name, v in one.added)),
        ("size", _sizes_in(fits[-1].problem, found.added) if fits else ""),
        ("error", _error_text(falls(fits, left or {})) if fits else ""),
        ("held out", _held_out(fits) if fits else ""),
        ("predicted", "; ".join(promises[-1:])),
        (
            "took",
            f"{plural(len([one for one in found.rounds if one.judged]), 'round')}, "
            f"{clock_time(found.spent)} of bench time",
        ),
    ]
    if found.sensor:
        facts.append(("sensor", f"of {' and '.join(found.sensor)} would distinguish what is left"))
    return Answer("good" if good else "warn", found.ended.heading, found.statement.rstrip("."), _said(facts))


def _said(facts: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    return tuple((head, text) for head, text in facts if text)


# --- a comparison -------------------------------------------------------------------------------------------


def _error_text(found: Sequence[ChannelFall]) -> str:
    """The systematic error of each channel; for two models, of those where it changed."""
    if not found:
        return ""
    guessed = [one.channel for one in found if one.guessed]
    note = f"; the noise of {', '.join(guessed)} is only guessed" if guessed else ""
    if len(found[0].sizes) > 1:
        changed = [one for one in found if one.changed]
        if not changed:
            return f"no channel's changes: {_state(found, -1)}{note}"
        said = [f"{one.channel} from {_size(one, 0)} to {_size(one, -1)}" for one in changed]
        return f"beyond the noise, {'; '.join(said)}{note}"
    return f"{_state(found, 0)}{note}"


def _state(found: Sequence[ChannelFall], place: int) -> str:
    beyond = [one for one in found if not one.within(place)]
    within = [one.channel for one in found if one.within(place)]
    if not beyond:
        return "within the noise on every channel" if len(found) > 1 else f"{within[0]} within its noise"
    said = "; ".join(f"{one.channel} {_size(one, place)}" for one in beyond)
    rest = f"; {', '.join(within)} within {'its' if len(within) == 1 else 'their'} noise" if within else ""
    return f"beyond the noise, {said}{rest}"


def _size(one: ChannelFall, place: int) -> str:
    amount = one.amount(place)
    return f"{one.sigmas(place)} ({amount})" if amount else one.sigmas(place)


def _held_out(fits: Sequence[FitResult]) -> str:
    """The error on records that no fit saw, in units of the noise; for two models, where it changed."""
    first, last = fits[0].heldout_errors, fits[-1].heldout_errors
    parts = []
    for name, error in first.items():
        after = last[name].nrmse
        if len(fits) == 1:
            parts.append(f"{name} {error.nrmse:.3g}")
        elif abs(error.nrmse - after) > _CHANGED * error.nrmse:
            parts.append(f"{name} {error.nrmse:.3g} to {after:.3g}")
    if not parts:
        return ""
    records = plural(len(fits[0].held_out), "record")
    return f"error on {records} that no fit saw, of the noise: {', '.join(parts)}"


def _most(model: ModelComparison) -> str:
    """The worst condition, if it is not due to chance."""
    from rigctl.analysis.levels import ALPHA

    worst = [one for one in model.where if one.by == "condition" and one.p_value < ALPHA][:2]
    return "; ".join(f"{one.label} ({100 * one.share_of_error:.0f} % of it)" for one in worst)


def _wanted(model: ModelComparison) -> str:
    """The equations that most probably lack a term."""
    known = [one for one in model.slots if one.log_evidence > 0.0]
    if not known or (model.rows and len(known[0].alike) > 1):
        return ""
    first = known[0]
    near = [
        one.slot for one in known[1:3] if first.log_evidence - one.log_evidence < _close(first.log_evidence)
    ]
    return f"a term at {' or '.join((first.slot, *near))}"


def _close(evidence: float) -> float:
    """Log-evidence from which two equations count as distinguished: odds of 20 to 1, or 1 % of a large
    one."""
    return max(3.0, 0.01 * evidence)


# --- a diagnosis --------------------------------------------------------------------------------------------


def _sentence(found: Diagnosis) -> str:
    """The verdict in a plain sentence; its statement if that is one."""
    if found.doubt:
        return f"{found.doubt}: these data cannot tell whether anything is missing"
    if found.verdict is Verdict.ADEQUATE:
        return found.statement
    names = " and ".join(found.effects)
    if found.verdict is Verdict.MISSING_EFFECT:
        return ". ".join(one.effect.summary.rstrip(".") for one in found.best.candidates)
    close = next((group for group in found.classes if len(group) > 1), ())
    if found.verdict is Verdict.AMBIGUOUS and close:
        others = [name for name in close if name not in found.effects]
        return f"something is missing, and these data cannot distinguish {names} from {_listed(others)}"
    said = found.statement.partition(": ")[0]
    nearest = " and ".join(found.best.effects)
    said = said.replace("in the library is this", f"in the library is {nearest}")
    return said.replace("as well as this", f"as well as {nearest}").replace(
        "The nearest is this", f"The nearest is {nearest}"
    )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def _size_head(found: Diagnosis) -> str:
    return (
        "size" if found.verdict is Verdict.MISSING_EFFECT else "most likely" if found.effects else "nearest"
    )


def _sizes(found: Diagnosis) -> str:
    """The parameters of the best set, with their consequence on a bench."""
    named = {one.effect: one for one in found.ranking}
    chosen = [one for one in found.best.candidates if one.name in named][:_MOST_SIZES]
    alone = found.verdict is Verdict.MISSING_EFFECT and len(chosen) == 1
    parts = []
    for one in chosen:
        text = _parameters(found, named[one.name])
        parts.append(text if alone else f"{one.name} ({text})" if text else one.name)
    return " and ".join(parts)


def _parameters(found: Diagnosis, one: Ranked) -> str:
    (candidate,) = (member for member in found.best.candidates if member.name == one.effect)
    said = []
    for name, value in one.parameters.items():
        plain = everyday(candidate.effect, name, value, found.best.fit.problem)
        said.append(f"{name} {value}" + (f", {plain}" if plain else ""))
    return "; ".join(said)


def _sureness(found: Diagnosis) -> str:
    """How significant it is, whether it predicts, and which effect is next best."""
    members = [one for one in found.ranking if one.effect in found.best.effects]
    if not members:
        return ""
    first = max(members, key=lambda one: one.size)
    parts = [f"stands out from the noise by {first.size:.0f} sigma"]
    if math.isfinite(first.heldout_before):
        parts.append(
            f"left-out conditions: error {first.heldout_before:.3g} to {first.heldout_after:.3g} of the noise"
        )
    others = [one for one in found.ranking if one.effect not in found.best.effects]
    if others:
        parts.append(f"next best {others[0].effect}, {100.0 * others[0].probability:.1f} %")
    against = sum(one.startswith("against ") for one in found.further_evidence)
    if against:
        parts.append(f"{against} thing{'s speak' if against > 1 else ' speaks'} against it")
    return "; ".join(parts)


def _left(found: Diagnosis) -> str:
    if not found.best.candidates:
        return ""
    if found.remainder is None:
        return f"nothing: with it the model agrees within the noise ({chance_text(found.p_value_after)})"
    left = found.remainder
    where = f", most at {left.slot}" if left.slot else ""
    over = f", over {left.over}" if left.over else ""
    return f"{share_text(left.share)} of the misfit, {left.size:.0f} sigma{where}{over}"


def _sizes_in(problem: Problem, added: Sequence[str]) -> str:
    """The parameters of effects in the model's file, with their consequence on a bench.

    A fit of other records, or with a new estimate of the noise, would differ slightly: one value is stated.
    """
    parts = []
    for name in added:
        effect = problem.model.effect(name)
        for key, one in problem.model.effects[name].items():
            if not one.fit:
                continue
            unit = parse_unit(one.unit or effect.parameter(key).unit)
            value = FoundParameter(one.si / unit.factor, unit.text, (one.std or math.nan) / unit.factor)
            plain = everyday(effect, key, value, problem)
            of = f"{name} " if len(added) > 1 else ""
            parts.append(f"{of}{key} {value}" + (f", {plain}" if plain else ""))
    return "; ".join(parts)


def _added(found: Diagnosis, effects: Sequence[str]) -> str:
    """An addition with its size."""
    named = {one.effect: one for one in found.ranking if one.effect in found.best.effects}
    parts = [f"{name} ({_parameters(found, named[name])})" if name in named else name for name in effects]
    return " and ".join(parts)
