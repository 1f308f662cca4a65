"""The result of a diagnosis, and what was added after it, for a reader who has a minute."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rigctl.analysis.adequacy import chance_text
from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.diagnosis_result import Diagnosis, FoundParameter, Ranked, Verdict
from rigctl.analysis.improve import Improvement, ImprovementEnd, Step
from rigctl.analysis.remainder import share_text, strength
from rigctl.analysis.text import in_words, would_be_missing
from rigctl.effects.registry import library
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.report.answer import Answer, Tone, error_text, fit_text, nonempty, pattern_of
from rigctl.report.everyday_units import everyday
from rigctl.report.systematic import falls, left_of, lefts_of_diagnosis
from rigctl.units import parse_unit, significant
from rigctl.wording import listed, number_of

_TONES: dict[Verdict, Tone] = {
    Verdict.ADEQUATE: "good",
    Verdict.MISSING_EFFECT: "warn",
    Verdict.AMBIGUOUS: "warn",
    Verdict.OUTSIDE_LIBRARY: "bad",
    Verdict.UNDECIDED: "open",
}
#: effects whose size is stated
_MOST_SIZES = 2


def diagnosis_answer(diagnosis: Diagnosis) -> Answer:
    """What is missing, its size, how certain that is, its effect on the error, and what is left."""
    if diagnosis.verdict is Verdict.ADEQUATE and not diagnosis.doubt:
        facts = [
            ("fit", fit_text(diagnosis.before)),
            ("error", error_text(falls([diagnosis.before.fit], [left_of(diagnosis.before)]))),
        ]
    else:
        facts = [
            ("fit", fit_text(diagnosis.before)),
            (_size_head(diagnosis), _sizes(diagnosis)),
            *(("or", one) for one in _others(diagnosis)),
            ("certain", _certain(diagnosis)),
            ("how sure", _sureness(diagnosis)),
            ("error", _error(diagnosis)),
            ("left", _left(diagnosis)),
        ]
    laws = [one.statement for one in diagnosis.laws if one.differs]
    facts.append(("its law", laws[0] if laws else ""))
    facts.append(("decided by", "; or ".join(diagnosis.decided_by)))
    facts.append(("sensors", _sensors(diagnosis)))
    unsure = diagnosis.doubt or diagnosis.if_exact or diagnosis.with_exact_sensors is not None
    tone: Tone = "open" if unsure else _TONES[diagnosis.verdict]
    return Answer(tone, diagnosis.title, _sentence(diagnosis), nonempty(facts), diagnosis.first)


def _sensors(diagnosis: Diagnosis) -> str:
    """Their errors beside what is named, or what exact ones would show where errors explain it as well."""
    exact = diagnosis.with_exact_sensors
    if exact is None:
        beside = f"beside it, {diagnosis.sensors_beside}" if diagnosis.sensors_beside else ""
        return "; ".join(one for one in (beside, diagnosis.if_exact) if one)
    return f"if they were exact, {would_be_missing(exact)}"


def _error(diagnosis: Diagnosis) -> str:
    """The systematic error; "" where the noise is not known, and no error is within it or beyond."""
    if diagnosis.verdict is Verdict.UNDECIDED:
        return ""
    fits = _fits(diagnosis)
    if len(fits) == 1:
        return error_text(falls(fits, [left_of(diagnosis.before)]), pattern_of(diagnosis.before))
    return error_text(falls(fits, lefts_of_diagnosis(diagnosis)))


def _fits(diagnosis: Diagnosis) -> list[FitResult]:
    """The model's fit, and that with the effects of the best set if there are any."""
    return [diagnosis.before.fit, *([diagnosis.best.fit] if diagnosis.best.candidates else [])]


def improvement_answer(improvement: Improvement) -> Answer:
    """What was added, how the error changed, and what the current model still lacks."""
    text = improvement.statement
    fits = [*([improvement.first.before.fit] if improvement.steps else []), improvement.last.before.fit]
    lefts = [left_of(one.before) for one in (improvement.first, improvement.last)][-len(fits) :]
    facts = [
        *(
            (f"version {step.version.number}", _added(improvement.steps[number].diagnosis, step.effects))
            for number, step in enumerate(improvement.steps)
        ),
        ("ambiguous", _not_distinguished(improvement.steps)),
        ("error", error_text(falls(fits, lefts))),
        *(("no fit saw", one.sentences[0]) for one in improvement.unseen),
    ]
    if improvement.ended is not ImprovementEnd.ADEQUATE:
        facts += [("now", f"{improvement.last.title}: {_sentence(improvement.last, others_follow=False)}")]
    tone: Tone = "good" if improvement.ended is ImprovementEnd.ADEQUATE else "warn"
    return Answer(tone, "What was added", text[0].upper() + text[1:], nonempty(facts), improvement.last.first)


def _sentence(diagnosis: Diagnosis, *, others_follow: bool = True) -> str:
    """The verdict in a plain sentence; its statement if that is one.

    Effects that the data cannot distinguish are only counted where others follow, each in a line of its own.
    """
    if diagnosis.verdict is Verdict.UNDECIDED and diagnosis.before.bounded:
        return diagnosis.statement
    if diagnosis.doubt:
        return f"{diagnosis.doubt}: these data cannot tell whether anything is missing"
    if diagnosis.verdict in (Verdict.ADEQUATE, Verdict.UNDECIDED):
        return diagnosis.statement
    if diagnosis.verdict is Verdict.MISSING_EFFECT:
        return ". ".join(one.effect.summary.rstrip(".") for one in diagnosis.best.candidates)
    if close := _close(diagnosis):
        counted = len(close) == 1 == len(diagnosis.effects) and others_follow
        chosen = f"these data cannot tell which of {len(close[0])} effects it is"
        return f"something is missing, and {chosen if counted else _alike(diagnosis)}"
    return diagnosis.opening


def _close(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """The effects of an ambiguous verdict, each with those that the data cannot distinguish from it."""
    if diagnosis.verdict is not Verdict.AMBIGUOUS:
        return []
    return [group for group in diagnosis.classes if len(group) > 1]


def _alike(diagnosis: Diagnosis) -> str:
    """What the data cannot distinguish from the effects of an ambiguous verdict; "" if it is not that."""
    pairs = [f"{first} from {listed(others, 'or')}" for first, *others in _close(diagnosis)]
    return f"these data cannot distinguish {', nor '.join(pairs)}" if pairs else ""


def _others(diagnosis: Diagnosis) -> list[str]:
    """What else it could be, each as a sentence with its name; empty unless the verdict is ambiguous."""
    close = _close(diagnosis)
    if not close:
        return []
    effects = library(diagnosis.best.fit.problem.model.family)
    names = dict.fromkeys(name for first, *others in close for name in others)
    return [in_words(effects[name]) if name in effects else name for name in names]


def _not_distinguished(steps: Sequence[Step]) -> str:
    """By which effects the additions could be replaced: the most probable was added."""
    texts = dict.fromkeys(_alike(step.diagnosis) for step in steps)
    return "; ".join(text for text in texts if text)


def _size_head(diagnosis: Diagnosis) -> str:
    return (
        "size"
        if diagnosis.verdict is Verdict.MISSING_EFFECT
        else "most likely"
        if diagnosis.effects
        else "nearest"
    )


def _sizes(diagnosis: Diagnosis) -> str:
    """The parameters of the best set, with their consequence on a bench."""
    named = {one.effect: one for one in diagnosis.ranking}
    chosen = [one for one in diagnosis.best.candidates if one.name in named][:_MOST_SIZES]
    alone = diagnosis.verdict is Verdict.MISSING_EFFECT and len(chosen) == 1
    parts = []
    for one in chosen:
        text = _parameters(diagnosis, named[one.name])
        said = in_words(one.effect)
        parts.append(text if alone else f"{said}, {text}" if text else said)
    return "; and ".join(parts)


def _parameters(diagnosis: Diagnosis, one: Ranked) -> str:
    (candidate,) = (member for member in diagnosis.best.candidates if member.name == one.effect)
    texts = []
    for name, value in one.parameters.items():
        plain = everyday(candidate.effect, name, value, diagnosis.best.fit.problem)
        texts.append(f"{name} {value}" + (f", {plain}" if plain else ""))
    return "; ".join(texts)


def _certain(diagnosis: Diagnosis) -> str:
    """What is certain of each effect; "" if all of it is."""
    levels = diagnosis.levels
    if all(one.law_sure for one in levels):
        return ""
    if len(levels) == 1 or not any(one.place_sure for one in levels):
        return levels[0].certain
    return "; ".join(f"{one.effect}: {one.certain}" for one in levels)


def _sureness(diagnosis: Diagnosis) -> str:
    """How significant it is, whether it predicts, and which effect is next best."""
    members = [one for one in diagnosis.ranking if one.effect in diagnosis.best.effects]
    if not members:
        return ""
    first = max(members, key=lambda one: one.size)
    parts = [f"stands out from the noise, {strength(first.size)}"]
    if math.isfinite(first.heldout_before):
        before, after = (significant(one, 3) for one in (first.heldout_before, first.heldout_after))
        parts.append(f"error on conditions left out: {before} to {after} of the noise")
    others = [one for one in diagnosis.ranking if one.effect not in diagnosis.best.effects]
    if others:
        parts.append(f"next best {others[0].effect}, {100.0 * others[0].probability:.1f} %")
    against = sum(one.startswith("against ") for one in diagnosis.further_evidence)
    if against:
        parts.append(f"{number_of(against, 'point')} of evidence against it")
    return "; ".join(parts)


def _left(diagnosis: Diagnosis) -> str:
    if not diagnosis.best.candidates:
        return ""
    if diagnosis.unproven_after:
        return _left_beside_floor(diagnosis)
    if diagnosis.remainder is None:
        chance = chance_text(diagnosis.p_value_after)
        if diagnosis.p_value_after < ALPHA:
            return f"only the shape of its law: the assumed law is rejected ({chance})"
        return f"nothing: with it the model agrees within the noise ({chance})"
    remainder = diagnosis.remainder
    where = f", most at {remainder.slot}" if remainder.slot else ""
    over = f", over {remainder.over}" if remainder.over else ""
    return f"{share_text(remainder.share)} of the misfit{where}{over} ({chance_text(remainder.p_value)})"


def _left_beside_floor(diagnosis: Diagnosis) -> str:
    """The error that the best set leaves where it is not shown to be noise."""
    fits, lefts = _fits(diagnosis), lefts_of_diagnosis(diagnosis)
    known = [one for one in falls(fits[-1:], lefts[-1:]) if one.channel in diagnosis.unproven_after]
    parts = [
        f"in {one.channel} an error" + (f" of {one.beside_noise(-1)}" if one.own else "") for one in known
    ]
    return f"{'; '.join(parts)}: slow noise or something else that is missing" if parts else ""


def sizes_in(problem: Problem, added: Sequence[str]) -> str:
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


def _added(diagnosis: Diagnosis, effects: Sequence[str]) -> str:
    """An addition with its size."""
    named = {one.effect: one for one in diagnosis.ranking if one.effect in diagnosis.best.effects}
    parts = [f"{name} ({_parameters(diagnosis, named[name])})" if name in named else name for name in effects]
    return " and ".join(parts)
