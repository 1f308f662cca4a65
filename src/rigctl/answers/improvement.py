"""An improved model in words: what was added, how the error changed, and what is left.

In: an `Improvement`, with one diagnosis for each step. Out: an `Answer` with the total change of the error,
and the evidence of every step. An addition that could have been another effect is said to be so: the most
probable one was added.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from rigctl.analysis.diagnosis_result import Diagnosis, FoundParameter
from rigctl.analysis.held_out_group import HeldOutGroup
from rigctl.analysis.improve import Addition, Improvement, ImprovementEnd, NotImproved, Step
from rigctl.answers.blocks import Answer, Block, Point, Points, Sentence, Tone, nonempty
from rigctl.answers.comparison import departures
from rigctl.answers.diagnosis import (
    alike_text,
    left_out,
    sentence_of,
    size_text,
    whole_diagnosis,
    written_laws,
)
from rigctl.answers.errors import error_text
from rigctl.answers.everyday_units import everyday
from rigctl.answers.findings import reasons, verdict
from rigctl.answers.findings.evidence import points
from rigctl.answers.findings.systematic_error import falls, left_of
from rigctl.answers.held_out import sentences
from rigctl.answers.model.errors import error_bars
from rigctl.model.fit.problem import Problem
from rigctl.units import parse_unit


def improvement_answer(improvement: Improvement) -> Answer:
    """What was added, how the error changed, and what the current model still lacks."""
    text = statement(improvement)
    # The error before all steps and after them, on the same data; without a step there is one fit and no
    # change.
    fits = [*([improvement.first.before.fit] if improvement.steps else []), improvement.last.before.fit]
    lefts = [left_of(one.before) for one in (improvement.first, improvement.last)][-len(fits) :]
    facts = [
        *(
            (f"version {step.version.number}", _added(improvement.steps[number].diagnosis, step.effects))
            for number, step in enumerate(improvement.steps)
        ),
        ("ambiguous", _not_distinguished(improvement.steps)),
        ("error", error_text(falls(fits, lefts))),
        *(("no fit saw", sentences(one)[0]) for one in improvement.unseen),
    ]
    if improvement.ended is not ImprovementEnd.ADEQUATE:
        facts += [("now", f"{improvement.last.title}: {sentence_of(improvement.last, others_follow=False)}")]
    tone: Tone = "good" if improvement.ended is ImprovementEnd.ADEQUATE else "warn"
    last = improvement.last
    return Answer(
        tone,
        "What was added",
        text[0].upper() + text[1:],
        nonempty(facts),
        last.first,
        remarks=(*departures(last.outside), *written_laws(last.laws)),
        more=("every step and its reasons", *left_out(last)),
        headed=False,
    )


def improvement_evidence(improvement: Improvement) -> tuple[Block, ...]:
    """Every step, how it ended, the whole decrease of the error, and what is left."""
    steps, text = improvement.steps, statement(improvement)
    errors: list[Block] = []
    if len(steps) > 1:
        each = [(f"with {' and '.join(one.effects)}", one.after) for one in steps]
        errors = error_bars([("before", steps[0].before), *each])
    return (
        *(block for step in steps for block in _step(step)),
        Sentence(text[0].upper() + text[1:], main=True),
        *errors,
        *unseen(improvement.unseen),
        *([Points.of("the model as it is now", [_history(steps[-1])])] if steps else []),
        *whole_diagnosis(improvement.last),
    )


def _history(step: Step) -> str:
    return f"rigctl model history {step.version.head.as_posix()} shows every version"


def _step(step: Step) -> list[Block]:
    """One addition: the effects, the evidence for and against them, and the change of the error."""
    with_it = f"with {' and '.join(step.effects)}"
    mine = [one for one in step.diagnosis.evidence if one.side and set(one.subject) <= set(step.effects)]
    return [
        Sentence(
            f"added {', '.join(step.effects)}",
            head=f"Version {step.version.number} of {step.version.head.as_posix()}",
            main=True,
        ),
        Sentence(reason_text(step.addition)),
        Points("", points(mine)),
        *error_bars([("before", step.before), (with_it, step.after)]),
    ]


def unseen(groups: Sequence[HeldOutGroup]) -> list[Block]:
    """How good the model is on the records that were left out, and what it misses there."""
    said = [
        Point(text, ("+" if group.as_good else "-") if number == 0 else "")
        for group in groups
        for number, text in enumerate(sentences(group))
    ]
    return [Points("records that no fit or search has seen", tuple(said))] if said else []


def _not_distinguished(steps: Sequence[Step]) -> str:
    """By which effects the additions could be replaced: the most probable was added."""
    texts = dict.fromkeys(alike_text(step.diagnosis) for step in steps)
    return "; ".join(text for text in texts if text)


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
    parts = [f"{name} ({size_text(diagnosis, named[name])})" if name in named else name for name in effects]
    return " and ".join(parts)


def statement(improvement: Improvement) -> str:
    """One sentence: the effects added, and why the loop ended."""
    last = improvement.last
    names = [name for step in improvement.steps for name in step.effects]
    added = f"added {', '.join(names)}" if names else "added nothing"
    if last.before.explained_by and not last.effects:
        return f"{added}: {verdict.statement(last)}"
    more = "more " if names else ""
    agrees = f"the model {'now ' if names else ''}agrees with the measurements within their noise"
    if not last.before.adequate:
        agrees = (
            "what is left may be the shape of a law alone: the model still does not agree with the "
            "measurements"
        )
    refused = f"{refusal_text(improvement)}, so that it is not added"
    doubt = verdict.doubt_text(last) or "it may be slow noise"
    why = {
        ImprovementEnd.ADEQUATE: agrees,
        ImprovementEnd.NOTHING_HELPS: "no further effect of the library lowers mBIC, and the model still "
        "does not agree with the measurements",
        ImprovementEnd.NOT_DECIDED: f"these data cannot tell whether anything {more}is missing: {doubt}",
        ImprovementEnd.MAX_EFFECTS: "no more effects were asked for, and the model still does not agree "
        "with the measurements",
        ImprovementEnd.NOT_SURE: "no further effect is certain to be what is missing",
        ImprovementEnd.NOT_PREDICTED: refused,
        ImprovementEnd.IMPLAUSIBLE: refused,
    }[improvement.ended]
    return f"{added}: {why}"


def refusal_text(improvement: Improvement) -> str:
    """Why the next effect was not added; "" if that is not why the loop ended."""
    refused = improvement.refused
    if not isinstance(refused, NotImproved):
        return "" if refused is None else reasons.reason_text(refused)
    where = {
        "held_out": f"the {refused.records} records held out",
        "conditions": "conditions left out of the fit",
        "blocks": "blocks of time left out of the fit",
    }[refused.where]
    return f"{' and '.join(refused.effects)} does not improve the prediction of {where}"


def reason_text(addition: Addition) -> str:
    """Why these effects are added; it says so if these data cannot distinguish them from others."""
    text = ". ".join(verdict.effect_text(*member) for member in addition.members)
    if len(addition.members) > 1:
        text += ". They help only together"
    if addition.following:
        text += f". No other effect gains as much alone; {', '.join(addition.following)} follows"
    if addition.unusual:
        text += f". It fits only with its {', and its '.join(addition.unusual)}"
    if addition.alike:
        text += f". These data cannot tell it from {', '.join(addition.alike)}: it is the most probable"
    if addition.nearest:
        text += (
            ". Something else may be missing as well, its law may have a different shape, or it is only the "
            "nearest in the library"
        )
    return text
