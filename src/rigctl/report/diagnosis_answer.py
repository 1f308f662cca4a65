"""The result of a diagnosis, and what was added after it, for a reader who has a minute."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rigctl.analysis.adequacy import chance_text
from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.diagnosis_result import Diagnosis, FoundParameter, Ranked, Verdict
from rigctl.analysis.improve import Improvement, ImprovementEnd, Step
from rigctl.analysis.remainder import share_text
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.report.answer import Answer, Tone, error_text, said
from rigctl.report.everyday_units import everyday
from rigctl.report.systematic import falls, left_of, left_of_diagnosis
from rigctl.units import parse_unit, significant

_TONES: dict[Verdict, Tone] = {
    Verdict.ADEQUATE: "good",
    Verdict.MISSING_EFFECT: "warn",
    Verdict.AMBIGUOUS: "warn",
    Verdict.OUTSIDE_LIBRARY: "bad",
}
#: effects whose size is stated
_MOST_SIZES = 2


def diagnosis_answer(found: Diagnosis) -> Answer:
    """What is missing, its size, how certain that is, its effect on the error, and what is left."""
    if found.verdict is Verdict.ADEQUATE and not found.doubt:
        facts = [("error", error_text(falls([found.before.fit], left_of(found.before))))]
    else:
        facts = [
            (_size_head(found), _sizes(found)),
            ("how sure", _sureness(found)),
            ("error", error_text(falls(_fits(found), left_of_diagnosis(found)))),
            ("left", _left(found)),
        ]
    laws = [one.statement for one in found.laws if one.differs]
    facts.append(("its law", laws[0] if laws else ""))
    tone: Tone = "warn" if found.doubt else _TONES[found.verdict]
    return Answer(tone, found.title, _sentence(found), said(facts))


def _fits(found: Diagnosis) -> list[FitResult]:
    """The model's fit, and that with the effects of the best set if there are any."""
    return [found.before.fit, *([found.best.fit] if found.best.candidates else [])]


def improvement_answer(found: Improvement) -> Answer:
    """What was added, how the error changed, and what the current model still lacks."""
    text = found.statement
    fits = [*([found.first.before.fit] if found.steps else []), found.last.before.fit]
    facts = [
        *(
            (f"version {step.version.number}", _added(found.steps[number].diagnosis, step.effects))
            for number, step in enumerate(found.steps)
        ),
        ("ambiguous", _not_distinguished(found.steps)),
        ("error", error_text(falls(fits, left_of(found.last.before)))),
        *(("no fit saw", one.sentences[0]) for one in found.unseen),
    ]
    if found.ended is not ImprovementEnd.ADEQUATE:
        facts += [("now", f"{found.last.title}: {_sentence(found.last)}")]
    tone: Tone = "good" if found.ended is ImprovementEnd.ADEQUATE else "warn"
    return Answer(tone, "What was added", text[0].upper() + text[1:], said(facts))


def _sentence(found: Diagnosis) -> str:
    """The verdict in a plain sentence; its statement if that is one."""
    if found.doubt:
        return f"{found.doubt}: these data cannot tell whether anything is missing"
    if found.verdict is Verdict.ADEQUATE:
        return found.statement
    if found.verdict is Verdict.MISSING_EFFECT:
        return ". ".join(one.effect.summary.rstrip(".") for one in found.best.candidates)
    if alike := _alike(found):
        return f"something is missing, and {alike}"
    said = found.statement.partition(": ")[0]
    nearest = " and ".join(found.best.effects)
    said = said.replace("in the library is this", f"in the library is {nearest}")
    return said.replace("as well as this", f"as well as {nearest}").replace(
        "The nearest is this", f"The nearest is {nearest}"
    )


def _alike(found: Diagnosis) -> str:
    """What the data cannot distinguish from the effects of an ambiguous verdict; "" if it is not that."""
    close = next((group for group in found.classes if len(group) > 1), ())
    if found.verdict is not Verdict.AMBIGUOUS or not close:
        return ""
    others = [name for name in close if name not in found.effects]
    return f"these data cannot distinguish {' and '.join(found.effects)} from {_listed(others)}"


def _not_distinguished(steps: Sequence[Step]) -> str:
    """Which of the additions other effects could replace: the most probable was added."""
    texts = dict.fromkeys(_alike(step.diagnosis) for step in steps)
    return "; ".join(text for text in texts if text)


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
        before, after = (significant(one, 3) for one in (first.heldout_before, first.heldout_after))
        parts.append(f"left-out conditions: error {before} to {after} of the noise")
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
        chance = chance_text(found.p_value_after)
        if found.p_value_after < ALPHA:
            return f"nothing but the shape of its law, which is rejected as assumed ({chance})"
        return f"nothing: with it the model agrees within the noise ({chance})"
    left = found.remainder
    where = f", most at {left.slot}" if left.slot else ""
    over = f", over {left.over}" if left.over else ""
    return f"{share_text(left.share)} of the misfit, {left.size:.0f} sigma{where}{over}"


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


def _added(found: Diagnosis, effects: Sequence[str]) -> str:
    """An addition with its size."""
    named = {one.effect: one for one in found.ranking if one.effect in found.best.effects}
    parts = [f"{name} ({_parameters(found, named[name])})" if name in named else name for name in effects]
    return " and ".join(parts)
