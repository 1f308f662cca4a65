"""How a survey is printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.markup import escape

from rigctl.analysis.agreement.adequacy import chance
from rigctl.answers.blocks import Answer, counted
from rigctl.answers.numbers import plural
from rigctl.cli.blocks import show_answer
from rigctl.cli.tables import console, table
from rigctl.monitoring.result import Line, Survey

#: number of series, runs and tests that a terminal shows
_COURSES, _LINES, _TESTS = 4, 24, 8
#: number of changes reported in full; of single runs and failures that are named
_CHANGES, _NAMED = 4, 3
#: number of notes on the data without ``-v``
_NOTES = 2
_HEADS = {"changed": "Changed", "no_change_seen": "No change seen", "cannot_tell": "Cannot tell"}


def show_survey(survey: Survey, written: Sequence[Path], *, verbose: bool = False) -> None:
    """Show the answer; with `verbose` the values of the runs, and the tested quantities."""
    out = console()
    notes = _notes_on_data(survey)
    more = [
        *counted(len(survey.lines), "run with its values", "runs with their values"),
        *counted(
            len(survey.judged.tested),
            "quantity with its scatter and p",
            "quantities with their scatter and p",
        ),
        *counted(max(len(survey.failed) - 1, 0), "more failure", "more failures"),
        *counted(len(survey.data_notes) - len(notes), "note on the data", "notes on the data"),
    ]
    show_answer(replace(survey_answer(survey), more=() if verbose else tuple(more)))
    if verbose:
        _show_runs(survey)
        _show_tests(survey)
        for line in survey.failed:
            out.print(f"  [yellow]{escape(line.entry.label)}: {escape(line.failed)}[/]", soft_wrap=True)
        notes = [survey.note_text(note) for note in survey.data_notes]
    for note in (*survey.named.remarks, *survey.notes, *notes):
        out.print(f"  [dim]{escape(note)}[/]", soft_wrap=True)
    for path in written:
        out.print(f"  written: {escape(path.as_posix())}", soft_wrap=True)


def _notes_on_data(survey: Survey) -> list[str]:
    """The notes on the data shown without ``-v``: not the routine ones, those of most runs first."""
    unusual = sorted(
        (one for one in survey.data_notes.items() if one[0].kind == "unusual"), key=lambda one: -len(one[1])
    )
    return [survey.note_text(note) for note, _ in unusual[:_NOTES]]


def survey_answer(survey: Survey) -> Answer:
    """The changes, the number of runs behind them, and the runs without information."""
    first, *others = [survey.sentence(change) for change in survey.changes] or [survey.statement]
    facts = [("and", sentence) for sentence in others[: _CHANGES - 1]]
    rest = [change.quantity.name for change in survey.changes[_CHANGES:]]
    if rest:
        facts.append(("and", f"{', '.join(rest)}"))
    facts += [("the model", _agreement(survey)), ("outliers", _apart(survey)), ("failed", _failures(survey))]
    return Answer(
        "good" if survey.verdict == "no_change_seen" else "warn",
        _HEADS[survey.verdict],
        first,
        tuple((head, text) for head, text in facts if text),
    )


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


def _show_runs(survey: Survey) -> None:
    out = console()
    courses = survey.shown()[:_COURSES]
    heads = [f"{one.quantity.name} [{one.quantity.unit}]" for one in courses]
    grid = table("run", survey.axis.name, *map(escape, heads), "agrees")
    for line in _shown(survey.lines):
        if line is None:
            grid.add_row("…")
        elif line.reading is None:
            grid.add_row(line.entry.label, survey.axis.text(line.entry), "[yellow]could not be read[/]")
        else:
            values = [survey.bare(c.quantity, c.values[line.index], c.std[line.index]) for c in courses]
            agrees = "yes" if line.reading.adequate else "no"
            grid.add_row(line.entry.label, survey.axis.text(line.entry), *values, agrees)
    out.print(grid)


def _shown(lines: Sequence[Line]) -> list[Line | None]:
    """All lines, or the first and the last of them with None between."""
    if len(lines) <= _LINES:
        return list(lines)
    half = _LINES // 2
    return [*lines[:half], None, *lines[-half:]]


def _show_tests(survey: Survey) -> None:
    out = console()
    grid = table("quantity", "scatter between runs", "p", "outlying runs")
    for one in survey.judged.tested[:_TESTS]:
        quantity = one.course.quantity
        between = "not known" if one.between is None else survey.amount_difference(quantity, one.between)
        p_value = "not tested" if one.p_value is None else chance(one.p_value)
        apart = ", ".join(survey.read[k].entry.label for k in one.apart[:2])
        grid.add_row(quantity.name, between, p_value, apart)
    out.print(grid)
    rest = len(survey.judged.tested) - _TESTS
    if rest > 0:
        out.print(f"  and {rest} more, none of them more significant", soft_wrap=True)
