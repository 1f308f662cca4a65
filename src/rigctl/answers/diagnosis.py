"""A diagnosis in words: what is missing, how certain that is, and what that rests on.

In: a `Diagnosis`. Out: an `Answer` with the facts a reader needs in order to act, and the evidence with the
ranking of all effects. The sentence is `rigctl.answers.findings.verdict`'s; here it gets its sizes, doubts
and next steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigctl.analysis.bootstrap import LEVEL, Bootstrap
from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.diagnosis_result import Diagnosis, Drift, Ranked, Verdict
from rigctl.analysis.laws.answer import LawAnswer
from rigctl.answers.blocks import (
    Answer,
    Block,
    Column,
    Figure,
    Point,
    Points,
    Sentence,
    Table,
    Tone,
    counted,
    nonempty,
)
from rigctl.answers.comparison import (
    MOST_FINDINGS,
    departures,
    findings,
    further_findings,
    place_in_words,
)
from rigctl.answers.errors import error_text, fit_text, in_brief, pattern_of
from rigctl.answers.everyday_units import everyday
from rigctl.answers.findings import tables as table_findings
from rigctl.answers.findings.decided_by import decisions
from rigctl.answers.findings.evidence import certain, points, sentence, would_be_missing
from rigctl.answers.findings.laws import law_text
from rigctl.answers.findings.reasons import remainder_text
from rigctl.answers.findings.sensor_errors import explanation
from rigctl.answers.findings.systematic_error import falls, left_of, lefts_of_diagnosis
from rigctl.answers.findings.verdict import doubt_text, opening, parameters_text, statement
from rigctl.answers.free_model import contradiction, free_model_text
from rigctl.answers.notes import all_notes, routine, unusual
from rigctl.effects.registry import library
from rigctl.model.fit.fit import FitResult
from rigctl.units import known_digits, parse_unit, significant
from rigctl.wording import chance, chance_text, listed, number_of, share_text, strength

_TONES: dict[Verdict, Tone] = {
    Verdict.ADEQUATE: "good",
    Verdict.MISSING_EFFECT: "warn",
    Verdict.AMBIGUOUS: "warn",
    Verdict.OUTSIDE_LIBRARY: "bad",
    Verdict.UNDECIDED: "open",
}
#: effects whose size is stated; next steps beside the answer; curves of laws
_MOST_SIZES, _MOST_STEPS, _MOST_LAWS = 2, 2, 4
#: effects of the ranking that are shown besides those of the verdict
_RANKED = 8
_CURVES = "the assumed law, and the one estimated from the data"
_SIGNATURE = "the grey line is the residual of the model in the worst record; the right candidate follows it"


def diagnosis_answer(diagnosis: Diagnosis) -> Answer:
    """What is missing, its size, how certain that is, its effect on the error, and what is left; with what
    has to be known before it is trusted."""
    # The order in which a reader decides: how large the effect is, what else it could be, where was looked,
    # how certain it is, and what it does to the error.
    if diagnosis.verdict is Verdict.ADEQUATE and not diagnosis.doubt:
        facts = [
            ("fit", fit_text(diagnosis.before)),
            ("error", error_text(falls([diagnosis.before.fit], [left_of(diagnosis.before)]))),
            ("free model", free_model_text(diagnosis.before)),
        ]
    else:
        facts = [
            ("fit", fit_text(diagnosis.before)),
            (_size_head(diagnosis), _sizes(diagnosis)),
            *(("or", one) for one in _others(diagnosis)),
            ("searched", _searched(diagnosis)),
            ("certain", _certain(diagnosis)),
            ("how sure", _sureness(diagnosis)),
            ("error", _error(diagnosis)),
            ("left", _left(diagnosis)),
        ]
    laws = [law_text(one) for one in diagnosis.laws if one.differs]
    facts.append(("its law", laws[0] if laws else ""))
    facts.append(("decided by", "; or ".join(decisions(diagnosis.decided_by))))
    facts.append(("sensors", _sensors(diagnosis)))
    # Open rather than good or bad wherever the verdict depends on something these data do not decide: a free
    # model that does better, an unknown noise, or sensors that may be wrong.
    unsure = (
        diagnosis.contradicted
        or diagnosis.doubt
        or diagnosis.if_exact
        or diagnosis.with_exact_sensors is not None
    )
    return Answer(
        "open" if unsure else _TONES[diagnosis.verdict],
        _title(diagnosis),
        sentence_of(diagnosis),
        nonempty(facts),
        diagnosis.first,
        remarks=(
            *(contradiction(diagnosis.before) if diagnosis.contradicted else ()),
            *departures(diagnosis.outside),
            *findings(diagnosis.before, MOST_FINDINGS),
            *_next_steps(diagnosis, _MOST_STEPS),
            *unusual(diagnosis.notes),
            *_intervals(diagnosis.bootstrap),
            *written_laws(diagnosis.laws),
        ),
        folded=further_findings(diagnosis.before),
        more=left_out(diagnosis),
        headed=_headed(diagnosis),
    )


def left_out(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What only the evidence has."""
    against = sum(one.side == "against" for one in diagnosis.further_evidence)
    return (
        *(["the ranking"] if diagnosis.ranking and diagnosis.verdict is not Verdict.ADEQUATE else []),
        *counted(against, "point of evidence against it", "points of evidence against it"),
        *counted(
            len(diagnosis.untestable),
            "effect that these data cannot test",
            "effects that these data cannot test",
        ),
        *counted(len(routine(diagnosis.notes)), "note on the data", "notes on the data"),
    )


def _title(diagnosis: Diagnosis) -> str:
    """The verdict with the effects that it names."""
    return diagnosis.title + (f" ({', '.join(diagnosis.effects)})" if diagnosis.effects else "")


def _headed(diagnosis: Diagnosis) -> bool:
    """Whether the statement does not begin with the title."""
    slow_noise = diagnosis.verdict is Verdict.UNDECIDED and not diagnosis.doubt
    return not slow_noise or diagnosis.before.adequacy.below_noise


def whole_diagnosis(diagnosis: Diagnosis) -> tuple[Block, ...]:
    """The verdict in full, the data, and the evidence."""
    before = diagnosis.before
    tone = "open" if diagnosis.contradicted or diagnosis.doubt else _TONES[diagnosis.verdict]
    return (
        *(Sentence(text, "warn", main=True) for text in diagnosis.first),
        Sentence(statement(diagnosis), tone, _title(diagnosis) if _headed(diagnosis) else "", main=True),
        *([] if before.rows else [Points.of("", in_brief(before))]),
        *([Points.of("", [f"decided by: {one}" for one in decisions(diagnosis.decided_by)])]),
        *departures(diagnosis.outside),
        *all_notes(diagnosis.notes),
        *findings(before),
        *diagnosis_evidence(diagnosis),
        *written_laws(diagnosis.laws),
    )


def diagnosis_evidence(diagnosis: Diagnosis) -> tuple[Block, ...]:
    """What a verdict rests on: the ranking, what speaks for and against it, and what cannot be tested."""
    # From the claim to what could overturn it: the ranking, points for and against, what the data cannot
    # tell apart or exclude, where a term is missing, and how the parameters moved; then curves, and what to
    # measure next. Of an adequate model only that is shown which does not presuppose that anything is
    # missing.
    before, adequate = diagnosis.before, diagnosis.verdict is Verdict.ADEQUATE
    slot = diagnosis.slot if not before.rows else ""
    blocks: list[Block] = []
    if diagnosis.remainder is not None and diagnosis.verdict is Verdict.OUTSIDE_LIBRARY:
        blocks.append(Sentence(remainder_text(diagnosis.remainder)))  # the statement of others has it
    if diagnosis.ranking and not adequate:
        blocks.append(_ranking(diagnosis))
    blocks.append(_weighed(diagnosis, adequate=adequate))
    alike = [f"these data cannot tell apart: {', '.join(names)}" for names in diagnosis.classes if names[1:]]
    if alike and not adequate:
        blocks.append(Points.of("", alike))
    if not adequate and (excluded := table_findings.exclusions(diagnosis)):
        blocks.append(Points.of("what is excluded", excluded, titled=False))
    if slot and not adequate:
        place = place_in_words(slot, before.fit.problem.model.family)
        blocks.append(Points.of("", [f"the equation that most probably lacks a term: {place}"]))
    if any(one.before for one in diagnosis.drift) and not adequate:
        blocks.append(_drift(diagnosis.drift))
    return (
        *blocks,
        Figure("signature", "the signature of each candidate", _SIGNATURE),
        *_laws(diagnosis.laws),
        *_intervals(diagnosis.bootstrap),
        *_untestable(diagnosis.untestable),
        *_next_steps(diagnosis),
    )


def _weighed(diagnosis: Diagnosis, *, adequate: bool) -> Points:
    """The evidence, the drifts only where no table has them."""
    shown = [one for one in diagnosis.further_evidence if adequate or one.quantity != "drift"]
    weighed = points(sorted(shown, key=lambda one: not one.side))
    return Points("evidence for and against", weighed, titled=False)


def _next_steps(diagnosis: Diagnosis, most: int | None = None) -> list[Block]:
    steps = diagnosis.next_steps[:most]
    return [Points.of("what to measure next", table_findings.next_steps(steps))] if steps else []


def _ranking(diagnosis: Diagnosis) -> Table:
    """Effects by their probability."""
    columns = (
        Column("effect", "effect"),
        Column("probability", "probability", lambda share: f"{100 * share:.1f} %", full=1.0),
        Column("score_p_value", "p of score", chance),
        Column("delta_bic", "ΔmBIC", "{:+.1f}".format),
        Column("kappa", "unabsorbed", lambda share: f"{100 * share:.0f} %"),
        Column("error_drop", "error", lambda share: f"{-100 * share:+.1f} %"),
        Column("held_out", "held out", words=True),
        Column("parameters", "parameters", words=True),
    )
    named = diagnosis.effects
    shown = [one for k, one in enumerate(diagnosis.ranking) if k < _RANKED or one.effect in named]
    rows = tuple(
        {
            **one.document(),
            "error_drop": one.error_drop or None,
            "held_out": _held_out(one),
            "parameters": parameters_text(one.parameters),
        }
        for one in shown
    )
    strong = frozenset(k for k, one in enumerate(shown) if one.effect in named)
    return Table(columns, rows, strong=strong)


def _held_out(one: Ranked) -> str | None:
    if not math.isfinite(one.heldout_before):
        return None
    return f"{significant(one.heldout_before)} to {significant(one.heldout_after)}"


def _drift(drift: Sequence[Drift]) -> Table:
    """The fitted parameters, without and with the effects found."""
    columns = (
        Column("parameter", "fitted parameter"),
        Column("before", "without", words=True),
        Column("after", "with it", words=True),
        Column("unit", "unit", words=True, unit=True),
        Column("change", "change", words=True),
    )
    rows = tuple(
        {
            "parameter": one.parameter,
            "before": known_digits(one.before, one.before_std)[0],
            "after": known_digits(one.after, one.after_std)[0],
            "unit": one.unit,
            "change": _change(one),
        }
        for one in drift
    )
    return Table(columns, rows)


def _change(one: Drift) -> str:
    """In per cent; for a temperature in kelvin, since a share of degrees Celsius is meaningless."""
    if parse_unit(one.unit).absolute_temperature:
        return f"{significant((one.after - one.before) * parse_unit(one.unit).factor, 2, sign=True)} K"
    return f"{100 * (one.after / one.before - 1):+.1f} %" if one.before else ""


def _laws(laws: Sequence[LawAnswer]) -> list[Block]:
    """What the data show about the laws of the effects, and where the file of a better one is."""
    if not laws:
        return []
    said = tuple(Point(law_text(one), "!" if one.differs else "") for one in laws)
    return [Points("laws of the effects", said), *(Figure(key, text) for key, text in law_figures(laws))]


def law_figures(laws: Sequence[LawAnswer]) -> list[tuple[str, str]]:
    """Keys and captions of the curves that a page draws, those that differ from the assumed ones first."""
    return [
        (
            f"law-{k}",
            f"{one.effect} over {one.law.driver.name}: {_CURVES}",
        )
        for k, one in enumerate(drawn_laws(laws))
    ]


def drawn_laws(laws: Sequence[LawAnswer]) -> list[LawAnswer]:
    """The laws that have a value over their range."""
    drawn = [one for one in laws if np.isfinite(one.law.asked).all() and np.isfinite(one.assumed).all()]
    return sorted(drawn, key=lambda one: not one.differs)[:_MOST_LAWS]


def written_laws(laws: Sequence[LawAnswer]) -> list[Block]:
    """Where the files of better laws are."""
    files = [f"written: {one.file.as_posix()}" for one in laws if one.file is not None]
    return [Points.of("", files)] if files else []


def _intervals(bootstrap: Bootstrap | None) -> list[Block]:
    """The interval of each parameter over the repetitions, beside the standard deviation of the fit."""
    if bootstrap is None:
        return []
    heads = ("parameter", "unit", "value", "interval", "± repeated", "± of the fit")
    rows = []
    for one in bootstrap.parameters:
        value, spread = known_digits(one.value, one.std)
        low, high = (known_digits(end, one.std)[0] for end in (one.low, one.high))
        fit = known_digits(one.value, one.fit_std)[1] if math.isfinite(one.fit_std) else ""
        cells = (one.name, one.unit, value, f"{low} … {high}", spread, fit)
        rows.append(dict(zip(heads, cells, strict=True)))
    columns = tuple(Column(head, head, words=True, unit=head == "unit") for head in heads)
    return [Table(columns, tuple(rows)), Points.of("", [_resampled(bootstrap)])]


def _resampled(intervals: Bootstrap) -> str:
    """One sentence on how the intervals were computed."""
    failed = f"; {intervals.failed} could not be fitted" if intervals.failed else ""
    return (
        f"{100 * LEVEL:.0f} % of {intervals.repetitions} repetitions, each with random signs for the "
        f"residuals of {intervals.clusters} {intervals.by}s{failed}"
    )


def _untestable(effects: Sequence[tuple[str, str]]) -> list[Block]:
    """Effects that are not testable with these data, by what would make them testable."""
    by_need: dict[str, list[str]] = {}
    for name, needs in effects:
        by_need.setdefault(needs, []).append(name)
    texts = [f"{', '.join(names)}: needs {needs}" for needs, names in by_need.items()]
    return [Points.of("not testable with these data", texts)] if texts else []


def _sensors(diagnosis: Diagnosis) -> str:
    """Their errors beside what is named, or what exact ones would show where errors explain it as well."""
    exact = diagnosis.with_exact_sensors
    if exact is None:
        sensors = diagnosis.sensors if diagnosis.effects else None
        beside = f"beside it, {explanation(sensors)}" if sensors is not None and sensors.matters else ""
        if_exact = "" if diagnosis.if_exact is None else sentence(diagnosis.if_exact)
        return "; ".join(one for one in (beside, if_exact) if one)
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


def sentence_of(diagnosis: Diagnosis, *, others_follow: bool = True) -> str:
    """The verdict in a plain sentence; its statement if that is one.

    Effects that the data cannot distinguish are only counted where others follow, each in a line of its own.
    """
    if diagnosis.verdict is Verdict.UNDECIDED and diagnosis.before.bounded:
        return statement(diagnosis)
    if diagnosis.doubt:
        return f"{doubt_text(diagnosis)}: these data cannot tell whether anything is missing"
    if diagnosis.verdict in (Verdict.ADEQUATE, Verdict.UNDECIDED):
        return statement(diagnosis)
    if diagnosis.verdict is Verdict.MISSING_EFFECT:
        return ". ".join(one.effect.summary.rstrip(".") for one in diagnosis.best.candidates)
    if close := _close(diagnosis):
        counted = len(close) == 1 == len(diagnosis.effects) and others_follow
        chosen = f"these data cannot tell which of {len(close[0])} effects it is"
        return f"something is missing, and {chosen if counted else alike_text(diagnosis)}"
    return opening(diagnosis)


def _close(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """The effects of an ambiguous verdict, each with those that the data cannot distinguish from it."""
    if diagnosis.verdict is not Verdict.AMBIGUOUS:
        return []
    return [group for group in diagnosis.classes if len(group) > 1]


def alike_text(diagnosis: Diagnosis) -> str:
    """What the data cannot distinguish from the effects of an ambiguous verdict; "" if it is not that."""
    pairs = [f"{first} from {listed(others, 'or')}" for first, *others in _close(diagnosis)]
    return f"these data cannot distinguish {', nor '.join(pairs)}" if pairs else ""


def _others(diagnosis: Diagnosis) -> list[str]:
    """What else it could be, each as a sentence with its name; empty unless the verdict is ambiguous."""
    close = _close(diagnosis)
    if not close:
        return []
    return [
        _named(diagnosis, name) for name in dict.fromkeys(name for _, *others in close for name in others)
    ]


def _named(diagnosis: Diagnosis, effect: str) -> str:
    """An effect as a sentence with its name."""
    known = library(diagnosis.best.fit.problem.model.family)
    return known[effect].described if effect in known else effect


def _size_head(diagnosis: Diagnosis) -> str:
    return (
        "size"
        if diagnosis.verdict is Verdict.MISSING_EFFECT
        else "most likely"
        if diagnosis.effects
        else "nearest"
    )


def _sizes(diagnosis: Diagnosis) -> str:
    """The effects of the best set with their parameters."""
    named = {one.effect: one for one in diagnosis.ranking}
    chosen = [one for one in diagnosis.best.candidates if one.name in named][:_MOST_SIZES]
    alone = diagnosis.verdict is Verdict.MISSING_EFFECT and len(chosen) == 1
    parts = []
    for one in chosen:
        text = size_text(diagnosis, named[one.name])
        said = one.effect.described
        parts.append(text if alone else f"{said}, {text}" if text else said)
    return "; and ".join(parts)


def size_text(diagnosis: Diagnosis, one: Ranked) -> str:
    """The parameters of an effect of the best set, with their consequence on a bench."""
    (candidate,) = (member for member in diagnosis.best.candidates if member.name == one.effect)
    texts = []
    for name, value in one.parameters.items():
        plain = everyday(candidate.effect, name, value, diagnosis.best.fit.problem)
        texts.append(f"{name} {value}" + (f", {plain}" if plain else ""))
    return "; ".join(texts)


def _searched(diagnosis: Diagnosis) -> str:
    """Where effects were looked for; "" if anywhere."""
    program = diagnosis.before.fit.problem.model.family.program
    if program is None:
        return ""
    where = f"only at inputs, outputs and parameters of {program.name}"
    return f"{where}; the cause may be something else inside {program.noun}"


def _certain(diagnosis: Diagnosis) -> str:
    """What is certain of each effect; "" if all of it is."""
    levels = diagnosis.levels
    if all(one.law_sure for one in levels):
        return ""
    if len(levels) == 1 or not any(one.place_sure for one in levels):
        return certain(levels[0])
    return "; ".join(f"{one.effect}: {certain(one)}" for one in levels)


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
        next_best = _named(diagnosis, others[0].effect)
        parts.append(f"next best, {100.0 * others[0].probability:.1f} %: {next_best}")
    against = sum(one.side == "against" for one in diagnosis.further_evidence)
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
    family = diagnosis.best.fit.problem.model.family
    where = f", mostly a term: {place_in_words(remainder.slot, family)}" if remainder.slot else ""
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
