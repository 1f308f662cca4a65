"""A survey in words: what has changed since when, the runs, and every quantity that was tested.

In: a `Survey` of many runs. Out: an `Answer` on the changes, and tables of runs, tests and changes. A change
is said of the nearest quantity, with all others that these runs do not distinguish from it; single outlying
runs are listed apart, since they are no change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rigctl.answers.blocks import Answer, Block, Column, Note, Points, Table, counted, nonempty
from rigctl.answers.numbers import plural
from rigctl.model.measured.note import Note as DataNote
from rigctl.monitoring.multiplicity import Change, Quantity
from rigctl.monitoring.result import Line, Survey
from rigctl.units import parse_unit, show, with_uncertainty
from rigctl.wording import chance, chance_text, number_of

#: number of series, runs and tests that are listed
_COURSES, _LINES, _TESTS = 4, 24, 8
#: number of changes reported in full; of single runs and failures that are named
_CHANGES, _NAMED = 4, 3
#: largest number of step levels in a sentence
_LEVELS = 6
#: the nearest quantity is named if its p-value is below this, though it is no change
_NEAR = 0.1
#: number of notes on the data beside the answer
_NOTES = 2
_HEADS = {"changed": "Changed", "no_change_seen": "No change seen", "cannot_tell": "Cannot tell"}
_KINDS = {"parameter": "of each run", "held": "shared", "effect": "effect"}


def survey_answer(survey: Survey, written: Sequence[Path] = ()) -> Answer:
    """The changes, the number of runs behind them, and the runs without information; the files `written`."""
    # One change is the sentence of the answer; the next ones follow as facts, and the rest by name only.
    first, *others = [sentence(survey, change) for change in survey.changes] or [statement(survey)]
    facts = [("and", sentence) for sentence in others[: _CHANGES - 1]]
    rest = [change.quantity.name for change in survey.changes[_CHANGES:]]
    facts += [("and", ", ".join(rest)), ("the model", _agreement(survey)), ("outliers", _apart(survey))]
    facts.append(("failed", _failures(survey)))
    notes = _notes_on_data(survey)
    files = [f"written: {path.as_posix()}" for path in written]
    more = (
        *counted(len(survey.lines), "run with its values", "runs with their values"),
        *counted(
            len(survey.judged.tested),
            "quantity with its scatter and p",
            "quantities with their scatter and p",
        ),
        *counted(max(len(survey.failed) - 1, 0), "more failure", "more failures"),
        *counted(len(survey.data_notes) - len(notes), "note on the data", "notes on the data"),
    )
    return Answer(
        "good" if survey.verdict == "no_change_seen" else "warn",
        _HEADS[survey.verdict],
        first,
        nonempty(facts),
        remarks=(
            *map(Note, (*remarks(survey), *survey.notes, *notes)),
            *([Points.of("", files)] if files else []),
        ),
        more=more,
    )


def survey_evidence(survey: Survey) -> list[Block]:
    """The values of the runs, the tested quantities, and what could not be read."""
    rest = len(survey.judged.tested) - _TESTS
    stated = _notes_on_data(survey)
    notes = [text for text in (note_text(survey, note) for note in survey.data_notes) if text not in stated]
    return [
        runs_table(survey),
        tests_table(survey, _TESTS),
        *([Points.of("", [f"and {rest} more, none of them more significant"])] if rest > 0 else []),
        *failures(survey),
        *map(Note, notes),
    ]


def failures(survey: Survey) -> list[Block]:
    """The runs that could not be read, and why."""
    failed = [f"{line.entry.label}: {line.failed}" for line in survey.failed]
    return [Points.of("runs that could not be read", failed, titled=False)] if failed else []


def _notes_on_data(survey: Survey) -> list[str]:
    """The notes on the data shown without ``-v``: not the routine ones, those of most runs first."""
    unusual = sorted(
        (one for one in survey.data_notes.items() if one[0].kind == "unusual"), key=lambda one: -len(one[1])
    )
    return [note_text(survey, note) for note, _ in unusual[:_NOTES]]


def _agreement(survey: Survey) -> str:
    agreeing = sum(line.reading is not None and line.reading.adequate for line in survey.lines)
    each = f"{plural(len(survey.read), 'run')}" if len(survey.read) != 1 else "one run"
    return f"agrees with {agreeing} of {each}, each fitted by itself" if survey.read else ""


def _apart(survey: Survey) -> str:
    """Single runs that are outliers among their neighbours: possibly mistakes, but no change."""
    quantities: dict[str, list[str]] = {}
    for one in survey.judged.tested:
        for k in one.apart:
            quantities.setdefault(survey.read[k].entry.label, []).append(one.course.quantity.name)
    shown = [f"{label} ({', '.join(names)})" for label, names in list(quantities.items())[:_NAMED]]
    if len(quantities) > _NAMED:
        shown.append(f"and {len(quantities) - _NAMED} more")
    return ", ".join(shown)


def _failures(survey: Survey) -> str:
    if not survey.failed:
        return ""
    first = survey.failed[0]
    count = f"{plural(len(survey.failed), 'run')} could not be read; " if len(survey.failed) > 1 else ""
    return f"{count}{first.entry.label}: {first.failed}"


def runs_table(survey: Survey, most: int = _LINES) -> Table:
    """The first and the last runs with the values of the first quantities."""
    courses = survey.shown()[:_COURSES]
    columns = (
        Column("run", "run"),
        Column("over", survey.axis.name, words=True),
        *(
            Column(one.quantity.name, f"{one.quantity.name} [{one.quantity.unit}]", words=True)
            for one in courses
        ),
        Column("agrees", "agrees", words=True),
    )

    def row(line: Line | None) -> dict[str, Any]:
        if line is None:
            return {"run": "…"}
        cells: dict[str, Any] = {"run": line.entry.label, "over": survey.axis.text(line.entry)}
        if line.reading is None:
            return cells | {"agrees": "could not be read"}
        values = {
            one.quantity.name: _bare(one.quantity, one.values[line.index], one.std[line.index])
            for one in courses
        }
        return cells | values | {"agrees": "yes" if line.reading.adequate else "no"}

    return Table(columns, tuple(map(row, _shown(survey.lines, most))))


def _shown(lines: Sequence[Line], most: int) -> list[Line | None]:
    """All lines, or the first and the last of them with None between."""
    if len(lines) <= most:
        return list(lines)
    half = most // 2
    return [*lines[:half], None, *lines[-half:]]


def tests_table(survey: Survey, most: int | None = None) -> Table:
    """The tested quantities, the most significant first."""
    columns = (
        Column("quantity", "quantity"),
        Column("kind", "kind", words=True),
        Column("between", "scatter between runs", words=True),
        Column("p", "p"),
        Column("apart", "outlying runs", words=True),
    )
    rows = tuple(
        {
            "quantity": one.course.quantity.name,
            "kind": _KINDS[one.course.quantity.kind],
            "between": "not known" if one.between is None else _scatter(one.course.quantity, one.between),
            "p": "not tested" if one.p_value is None else chance(one.p_value),
            "apart": ", ".join(survey.read[k].entry.label for k in one.apart[:_NAMED]),
        }
        for one in survey.judged.tested[:most]
    )
    return Table(columns, rows)


def changes_table(survey: Survey) -> list[Table]:
    """What has changed, by how much, since when; none if nothing has."""
    columns = (
        Column("what", "what"),
        Column("before", "before", words=True),
        Column("after", "at the end", words=True),
        Column("between", "began", words=True),
        Column("first", "first significant at", words=True),
        Column("p", "p"),
        Column("alike", "or", words=True),
    )
    rows = tuple(
        {
            "what": change.quantity.name,
            "before": _amount(change.quantity, change.shape.before, change.shape.before_std),
            "after": _amount(change.quantity, change.shape.after, change.shape.after_std),
            "between": " to ".join(between(survey, change)),
            "first": survey.read[min(change.first_sure, len(survey.read)) - 1].entry.label,
            "p": chance(change.p_value),
            "alike": ", ".join(change.alike),
        }
        for change in survey.changes
    )
    caption = (
        "the onset is between the two with 95 % probability; ± is the uncertainty due to the runs and their "
        "scatter"
    )
    return [Table(columns, rows, caption)] if rows else []


_NAMINGS = {
    "by_diagnosis": "named by a diagnosis of one run: {verdict}",
    "not_diagnosed": "not diagnosed: this is what changes, which need not be the cause",
    "run_failed": "{names} could not be diagnosed: {problem}",
    "outside_library": (
        "no effect of the library explains what the model lacks there; 'rigctl discover' looks for a formula"
    ),
    "too_little": "a single run shows too little of it to identify it",
    "parameters_free": "the model agrees after the change with {names} free in that run",
    "no_single_change": "with {names} in the model no single quantity changes significantly",
}


def remarks(survey: Survey) -> list[str]:
    """How what has changed was named, or why it could not be."""
    how = survey.named.naming
    if how is None:
        return []
    verdict = survey.named.verdict.replace("_", " ")
    return [_NAMINGS[how.kind].format(verdict=verdict, names=" and ".join(how.names), problem=how.problem)]


def note_text(survey: Survey, note: DataNote) -> str:
    """A note on the data, with the entries to which it applies unless these are all."""
    labels = survey.data_notes[note]
    if len(labels) == len(survey.read):
        return note.text
    more = f" and {len(labels) - _NAMED} more" if len(labels) > _NAMED else ""
    return f"{note.text} ({', '.join(labels[:_NAMED])}{more})"


def statement(survey: Survey) -> str:
    """The findings, in one or more sentences."""
    count = len(survey.read)
    tests = sum(one.found is not None for one in survey.judged.tested)
    what = number_of(count, "run")
    if tests:  # otherwise it is the number of runs that is too small
        what += f", {number_of(tests, 'quantity', 'quantities')}"
    if survey.changes:
        return ". ".join(sentence(survey, change) for change in survey.changes)
    if not survey.judged.enough:
        return (
            f"These data cannot tell: {what}. With so few runs their scatter without a change is "
            "unknown, and no change can be distinguished from it"
        )
    nearest = survey.judged.tested[0]
    text = f"No change is detected: {what}, none of which changes by more than the runs scatter"
    if nearest.p_value is not None and nearest.p_value < _NEAR:
        text += f"; {nearest.course.quantity.name} comes closest ({chance_text(nearest.p_value)})"
    return text


def sentence(survey: Survey, change: Change) -> str:
    """One change: what, from and to which value, since when, when first significant, and its p-value."""
    shape, lines = change.shape, survey.read
    names = " or ".join([change.quantity.name, *change.alike[:4]])
    if len(change.alike) > 4:
        names += f" or one of {len(change.alike) - 4} others"
    before, after = _amount(change.quantity, shape.before), _amount(change.quantity, shape.after)
    verb = "grew" if shape.after > shape.before else "fell"
    verb = f"{verb} from {before} to {after}"
    if len(change.steps) > 1:
        levels = [_amount(change.quantity, level) for level in change.levels[:_LEVELS]]
        more = f" and {len(change.levels) - _LEVELS} more" if len(change.levels) > _LEVELS else ""
        verb = f"changed in steps, {', '.join(levels)}{more}"
    # Two dates are stated: when it began, estimated from all runs, and the run from which on it was
    # significant, which is later.
    since = lines[min(change.steps[0] if change.steps else shape.begins, len(lines) - 1)]
    first = lines[min(change.first_sure, len(lines)) - 1]
    text = (
        f"{names} {verb}, since {survey.axis.text(since.entry)}, first significant at {first.entry.label} "
        f"({chance_text(change.p_value)})"
    )
    if change.alike:
        text += "; these runs cannot tell which of them"
    return text


def between(survey: Survey, change: Change) -> tuple[str, str]:
    """The earliest and the latest start of the change, in words."""
    lines = survey.read
    early, late = max(change.shape.earliest - 1, 0), min(change.shape.latest, len(lines) - 1)
    return survey.axis.text(lines[early].entry), survey.axis.text(lines[late].entry)


def _amount(quantity: Quantity, si: float, std: float | None = None) -> str:
    """A value of a quantity in its unit."""
    unit = parse_unit(quantity.unit)
    value = unit.from_si(si, difference=quantity.difference)
    if std is None or not std > 0.0 or not math.isfinite(std):
        return show(si, quantity.unit, difference=quantity.difference, digits=3)
    return with_uncertainty(value, std / unit.factor, quantity.unit)


def _bare(quantity: Quantity, si: float, std: float) -> str:
    """A value with its standard deviation, without its unit; empty if a run does not determine it."""
    if not math.isfinite(si):
        return ""
    unit = parse_unit(quantity.unit)
    return with_uncertainty(unit.from_si(float(si), difference=quantity.difference), float(std) / unit.factor)


def _scatter(quantity: Quantity, si: float) -> str:
    """A scatter of a quantity in its unit."""
    return show(si, quantity.unit, difference=True, digits=2)
