"""A comparison in words: how well the models agree, where the last one fails, and the figures behind it.

In: a `Comparison` of one or more models on the same data. Out: an `Answer` about the last model, which is
the one in question, and the evidence: statements, then the numbers of every test, channel and place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from rigctl.analysis.agreement.localisation import Place
from rigctl.analysis.comparison_result import Comparison, ModelComparison
from rigctl.analysis.decision_levels import ALPHA, SLOT_SEPARABLE
from rigctl.answers.blocks import (
    Answer,
    Bar,
    Bars,
    Block,
    Column,
    Details,
    Note,
    Points,
    Sentence,
    Table,
    Tone,
    counted,
    nonempty,
)
from rigctl.answers.errors import error_text, fit_text, held_out_text, in_brief, noise_known_from, pattern_of
from rigctl.answers.findings import tables as table_findings
from rigctl.answers.findings.agreement import prior_text, record_level_text
from rigctl.answers.findings.decided_by import decisions
from rigctl.answers.findings.systematic_error import falls, left_of
from rigctl.answers.free_model import contradiction, free_model_bars, free_model_text
from rigctl.answers.notes import all_notes, routine, unusual
from rigctl.answers.numbers import resolved
from rigctl.answers.trends import trend_text
from rigctl.answers.value_table import value_tables
from rigctl.model.validity import Departure
from rigctl.physics.family import ModelFamily
from rigctl.units import significant
from rigctl.wording import chance, number_of

_TONES: dict[bool | None, Tone] = {True: "good", False: "bad", None: "open"}
_TITLES = {True: "Agrees", False: "Does not agree", None: "Cannot tell"}
_ADEQUATE = {True: "yes", False: "no", None: "cannot tell"}
_ASKS = {
    "score": "does any effect of the library stand out?",
    "plane": "does the error change with the operating point?",
    "chi2": "is the whole misfit more than noise?",
    "inputs": "does the error follow the past of an input?",
}
#: kinds of places, with the number that is shown of each
_KINDS = {
    "channel": ("channel", None),
    "phase": ("phase", None),
    "cell": ("channel and phase", 5),
    "condition": ("condition", 5),
    "state": ("range of a channel", 3),
    "stretch": ("worst stretches", 3),
}
#: trends and equations that are shown, and findings on the values of a table beside an answer
_MOST, MOST_FINDINGS = 6, 2
#: labels of records that are listed
_FEW = 6

_two, _three = partial(significant, digits=2), partial(significant, digits=3)
_signed_two, _signed_three = partial(_two, sign=True), partial(_three, sign=True)
_fixed_three, _five_decimals = "{:.3f}".format, "{:.5f}".format


def comparison_answer(comparison: Comparison) -> Answer:
    """How well the last model agrees and where it fails most, with the change of the error since the first,
    and what has to be known before it is trusted."""
    models, last = comparison.models, comparison.models[-1]
    verdict = last.adequacy.verdict
    # The last model is the one of the answer; the others are what it is compared with.
    facts = [("beside", model.statement) for model in models[:-1]]
    facts += [("fit", fit_text(last)), ("error", _error(models)), ("free model", free_model_text(last))]
    if verdict is False:
        facts += [("mostly at", _most(last)), ("lacks", "" if last.bounded else _wanted(last))]
    held_out = ("held out", held_out_text([model.fit for model in models]))
    facts.insert(len(models) + 1 if len(models) > 1 else len(facts), held_out)
    facts.append(("decided by", "; or ".join(decisions(last.decided_by))))
    agrees = None if last.contradicted else verdict
    return Answer(
        _TONES[agrees],
        _TITLES[agrees],
        last.statement,
        nonempty(facts),
        (*(f"{model.name}: {one}" for model in models[:-1] for one in model.first), *last.first),
        remarks=(
            *(block for model in models for block in _warnings(model)),
            *unusual(comparison.notes),
            *findings(last, MOST_FINDINGS),
        ),
        folded=further_findings(last),
        more=(
            *counted(len(routine(comparison.notes)), "note on the data", "notes on the data"),
            "all tests and locations",
        ),
        headed=False,
    )


def comparison_evidence(comparison: Comparison) -> tuple[Block, ...]:
    """The statement on each model, and every figure behind it."""
    models, last = comparison.models, comparison.models[-1]
    verdicts = tuple(block for model in models for block in verdict(model))
    if len(models) > 1:
        return (*verdicts, *_data(comparison), _side_by_side(models))
    return (
        *verdicts,
        *numbers(comparison),
        *(Points.of("", [f"decided by: {one}"]) for one in decisions(last.decided_by)),
        *where(last),
    )


def verdict(model: ModelComparison) -> list[Block]:
    """What has to be known first, the statement, and where it leaves what it was made for."""
    return [
        *(Sentence(text, "warn", main=True) for text in model.first),
        Sentence(model.statement, _TONES[None if model.contradicted else model.adequacy.verdict], main=True),
        *_warnings(model),
        *findings(model),
    ]


def _warnings(model: ModelComparison) -> list[Block]:
    return [
        *contradiction(model),
        *departures(model.outside),
        *(Sentence(band.statement) for band in model.curve_bands),
    ]


def departures(outside: Sequence[Departure]) -> list[Block]:
    """A warning for each range of validity that a model leaves."""
    return [Sentence(one.statement, "warn", "warning") for one in outside]


def findings(model: ModelComparison, most: int | None = None) -> list[Block]:
    """What the values of a table can tell."""
    shown = table_findings.findings(model.findings[:most])
    return [Points.of("what these data can and cannot tell", shown, titled=False)] if shown else []


def further_findings(model: ModelComparison) -> tuple[Block, ...]:
    """The findings that an answer leaves out."""
    rest = table_findings.findings(model.findings[MOST_FINDINGS:])
    return (Details(number_of(len(rest), "more finding"), (Points.of("", rest),)),) if rest else ()


def numbers(comparison: Comparison) -> list[Block]:
    """The data, the errors, the tests and the record-level parameters, in technical terms."""
    models = comparison.models
    several = len(models) > 1
    return [
        *_data(comparison),
        *([_side_by_side(models)] if several else []),
        *value_tables(models),
        *(block for model in models for block in _numbers_of(model, model.name if several else "")),
    ]


def _numbers_of(model: ModelComparison, caption: str) -> list[Block]:
    tables: list[Block] = [_channels(model), _tests(model), *_record_level(model)]
    return [
        *(replace(one, caption=caption) if isinstance(one, Table) else one for one in tables),
        *([] if model.rows else [Points.of(caption, in_brief(model))]),
        *free_model_bars(model, caption),
    ]


def statements(comparison: Comparison) -> list[Block]:
    """The statement on each model, with the bands of its measured curves, where the answer is another."""
    return [
        Note(text)
        for model in comparison.models
        for text in (model.statement, *(band.statement for band in model.curve_bands))
    ]


def all_held_out(comparison: Comparison) -> list[Block]:
    """The labels of the records held out, if `numbers` does not list them all."""
    labels = comparison.held_out
    return [Details("all records held out", (Points.of("", labels),))] if labels[_FEW:] else []


def where(model: ModelComparison) -> list[Block]:
    """Where in the data a model fails, the worst of each kind first, and which equation lacks a term."""
    # A model that agrees has no place where it fails. The rows of a table have no course: only conditions
    # are places there.
    if model.adequate:
        return []
    places = [place for place in model.where if place.by == "condition"] if model.rows else model.where
    trends = [
        f"{trend_text(one)} ({abs(one.z):.0f} sigma)"
        + ": the wrong direction" * (one.wrong_sign and one.matters)
        for one in model.trends
        if one.significant
    ][:_MOST]
    return [
        *([_places(places)] if places else []),
        *([Points.of("trends over the operating variables", trends)] if trends else []),
        *_slots(model),
    ]


def _error(models: Sequence[ModelComparison]) -> str:
    last = models[-1]
    if len(models) > 1:
        return error_text(falls([model.fit for model in models], [left_of(model) for model in models]))
    if last.adequacy.undecided:  # where the noise is not known, no error is within it or beyond
        return ""
    return error_text(falls([last.fit], [left_of(last)]), pattern_of(last))


def _data(comparison: Comparison) -> list[Block]:
    """How the data were taken, and which records no fit saw."""
    labels, notes = comparison.held_out, all_notes(comparison.notes)
    if not labels:
        return [*notes]
    more = len(labels) - _FEW
    few = ", ".join(labels[:_FEW]) + (f" and {more} more" if more > 0 else "")
    return [*notes, Points.of("", [f"held out: {number_of(len(labels), 'record')} ({few})"])]


def _channels(model: ModelComparison) -> Table:
    """Model less measurement, channel by channel."""
    channels = model.channels()
    held = any(one["heldout_rmse"] is not None for one in channels.values())
    columns = (
        Column("channel", "channel"),
        Column("rmse", "RMSE", significant),
        *((Column("heldout_rmse", "held out", significant),) if held else ()),
        Column("bias", "bias", _signed_two),
        Column("max", "largest", _signed_three),
        Column("free", "free model", significant),
        Column("noise", "noise"),
        Column("unit", "unit", words=True, unit=True),
        Column("nrmse", "RMSE/noise", _fixed_three),
        Column("chi2_reduced", "χ²", _fixed_three),
        Column("r2", "R²", _five_decimals),
        Column("known", "noise from", words=True),
        Column("masked", "spikes masked"),
    )
    titles = model.fit.problem.measurements.titles
    free = {one.channel: one.document()["free"] for one in model.achievable}
    rows = (
        {**_channel(titles.get(name, name), one), "free": free.get(name)} for name, one in channels.items()
    )
    return Table(columns, tuple(rows))


def _channel(title: str, one: dict[str, Any]) -> dict[str, Any]:
    share = one["noise_share"]
    return {
        **one,
        "channel": title,
        "bias": resolved(one["bias"], one["rmse"]),
        "noise": f"{_two(100 * share)} %" if share else _three(one["noise"]),
        "chi2_reduced": None if one["noise_source"] == "floor" else one["chi2_reduced"],
        "known": noise_known_from(one),
        "masked": one["masked"] or None,
    }


def _side_by_side(models: Sequence[ModelComparison]) -> Table:
    """One column for each model."""
    columns = (Column("what", ""), *(Column(str(k), model.name) for k, model in enumerate(models)))
    channels = [model.channels() for model in models]
    rows: list[dict[str, Any]] = []
    # Channel by channel, with a line for each figure that any of the models has; below that what concerns
    # all channels. χ² needs a noise level, and is left out where there is none.
    for name in dict.fromkeys(name for by_name in channels for name in by_name):
        rows.append({"what": name})
        for label, key in (("RMSE", "rmse"), ("held out", "heldout_rmse"), ("noise", "noise")):
            cells = {
                str(k): f"{significant(by_name[name][key])} {by_name[name]['unit']}"
                for k, by_name in enumerate(channels)
                if name in by_name and by_name[name][key] is not None
            }
            rows += [{"what": f"  {label}", **cells}] if cells else []
    if not any(model.fit.problem.noise.own_scale for model in models):
        rows.append({"what": "reduced χ²", **_each(models, lambda one: significant(one.fit.chi2_reduced))})
    for test in _ASKS:
        tests = {
            str(k): chance(model.adequacy.tests[test].p_value)
            for k, model in enumerate(models)
            if test in model.adequacy.tests
        }
        rows += [{"what": f"p of {test} test", **tests}] if tests else []
    rows.append({"what": "p of all", **_each(models, lambda one: chance(one.adequacy.p_value))})
    rows.append({"what": "adequate", **_each(models, lambda one: _ADEQUATE[one.adequacy.verdict])})
    return Table(columns, tuple(rows))


def _each(models: Sequence[ModelComparison], text: Callable[[ModelComparison], str]) -> dict[str, str]:
    return {str(k): text(model) for k, model in enumerate(models)}


def _tests(model: ModelComparison) -> Table:
    columns = (
        Column("test", "test"),
        Column("asks", "what it asks", words=True),
        Column("statistic", "statistic", significant),
        Column("dof", "dof"),
        Column("p", "p", chance),
    )
    rows: list[dict[str, Any]] = [
        {
            "test": name,
            "asks": _ASKS.get(name, ""),
            "statistic": test.statistic,
            "dof": test.dof or None,
            "p": test.p_value,
        }
        for name, test in model.adequacy.tests.items()
    ]
    # The last row is the one that decides: the tests share one level.
    count = len(model.adequacy.tests)
    asked = f"Holm: the smallest p times {count}"
    return Table(columns, (*rows, {"test": "all", "asks": asked, "p": model.adequacy.p_value}))


def _record_level(model: ModelComparison) -> list[Block]:
    """The record-level parameters, by quantity, and which of them are suspicious."""
    if not model.record_level:
        return []
    columns = (
        Column("meaning", "record-level parameter"),
        Column("prior", "prior", words=True),
        *(Column(key, key) for key in ("lowest", "mean", "highest")),
        Column("records", "records"),
    )
    rows = tuple(
        {
            "meaning": one.meaning,
            "prior": prior_text(one),
            "lowest": one.shown(float(one.values.min())),
            "mean": one.shown(float(one.values.mean())),
            "highest": one.shown(float(one.values.max())),
            "records": one.values.size,
        }
        for one in model.record_level
    )
    suspicious = frozenset(k for k, one in enumerate(model.record_level) if one.evident)
    said = [
        record_level_text(one) for one in model.record_level if one.evident and one is not model.suspicious
    ]
    return [
        Table(columns, rows, strong=suspicious),
        *(Sentence(text[0].upper() + text[1:]) for text in said),
    ]


def _places(places: Sequence[Place]) -> Table:
    columns = (
        Column("label", "where it fails"),
        Column("share", "share of the error", lambda share: f"{100 * share:.0f} %", full=1.0),
        Column("rmse", "error/noise", "{:.2f}".format),
        Column("p", "p", chance),
    )
    kinds = list(dict.fromkeys(place.by for place in places))
    if "phase" not in kinds:  # with a single phase, the channel names suffice
        kinds = [kind for kind in kinds if kind != "cell"]
    rows: list[dict[str, Any]] = []
    for kind in kinds:
        name, most = _KINDS[kind]
        rows.append({"label": f"by {name}"})
        rows += [
            {
                "label": f"  {place.label}",
                "share": max(place.share_of_error, 0.0),
                "rmse": place.rmse,
                "p": place.p_value,
            }
            for place in [place for place in places if place.by == kind][:most]
        ]
    return Table(columns, tuple(rows))


def _slots(model: ModelComparison) -> list[Block]:
    shown = [slot for slot in model.slots if slot.log_evidence > 0.0][:_MOST]
    if not shown:
        return []
    if model.rows and len(shown[0].alike) > 1:
        alike = ", ".join((shown[0].slot, *shown[0].alike))
        return [Points.of("", [f"single values do not show which equation lacks a term: {alike}"])]
    bars = tuple(
        Bar(one.slot, one.log_evidence / shown[0].log_evidence, significant(one.log_evidence), one.meaning)
        for one in shown
    )
    program = model.fit.problem.model.family.program
    which = "equation lacks a term"
    if program is not None:
        which = f"input or output of {program.noun} may lack a term, if nothing inside does"
    return [Bars(f"which {which}, log-evidence", bars)]


def _most(model: ModelComparison) -> str:
    """The worst condition, if it is not due to chance."""
    worst = [one for one in model.where if one.by == "condition" and one.p_value < ALPHA][:2]
    return "; ".join(f"{one.label} ({100 * one.share_of_error:.0f} % of it)" for one in worst)


def _wanted(model: ModelComparison) -> str:
    """The equations that most probably lack a term."""
    # With a table, slots that act alike on single values say nothing about the place.
    known = [one for one in model.slots if one.log_evidence > SLOT_SEPARABLE]
    if not known or (model.rows and len(known[0].alike) > 1):
        return ""
    near = [one for one in known if one.slot in known[0].alike][:2]
    family = model.fit.problem.model.family
    places = [place_in_words(one.slot, family) for one in (known[0], *near)]
    if family.program is not None:
        places.append(f"inside {family.program.name}")
    return f"a term: {'; or '.join(places)}"


def place_in_words(slot: str, family: ModelFamily) -> str:
    """Where a term is missing, in words, with its name in brackets; slots that nothing separates in words."""
    known = {one.name: one.meaning for one in family.slots}
    meanings = [known.get(name) or name for name in slot.split(" + ")]
    return f"{meanings[0]} ({slot})" if known.get(slot) else ", ".join(meanings)
