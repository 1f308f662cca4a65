"""A survey in words: what has changed since when, the runs, and every quantity that was tested."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rigctl.answers.blocks import Answer, Block, Column, Note, Points, Table, counted, nonempty
from rigctl.answers.numbers import plural
from rigctl.monitoring.result import Line, Survey
from rigctl.wording import chance

#: number of series, runs and tests that are listed
_COURSES, _LINES, _TESTS = 4, 24, 8
#: number of changes reported in full; of single runs and failures that are named
_CHANGES, _NAMED = 4, 3
#: number of notes on the data beside the answer
_NOTES = 2
_HEADS = {"changed": "Changed", "no_change_seen": "No change seen", "cannot_tell": "Cannot tell"}
_KINDS = {"parameter": "of each run", "held": "shared", "effect": "effect"}


def survey_answer(survey: Survey, written: Sequence[Path] = ()) -> Answer:
    """The changes, the number of runs behind them, and the runs without information; the files `written`."""
    first, *others = [survey.sentence(change) for change in survey.changes] or [survey.statement]
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
            *map(Note, (*survey.named.remarks, *survey.notes, *notes)),
            *([Points.of("", files)] if files else []),
        ),
        more=more,
    )


def survey_evidence(survey: Survey) -> list[Block]:
    """The values of the runs, the tested quantities, and what could not be read."""
    rest = len(survey.judged.tested) - _TESTS
    stated = _notes_on_data(survey)
    notes = [text for text in map(survey.note_text, survey.data_notes) if text not in stated]
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
    return [survey.note_text(note) for note, _ in unusual[:_NOTES]]


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
            one.quantity.name: survey.bare(one.quantity, one.values[line.index], one.std[line.index])
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
            "between": "not known"
            if one.between is None
            else survey.amount_difference(one.course.quantity, one.between),
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
            "before": survey.amount(change.quantity, change.shape.before, change.shape.before_std),
            "after": survey.amount(change.quantity, change.shape.after, change.shape.after_std),
            "between": " to ".join(survey.between(change)),
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
