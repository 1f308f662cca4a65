"""How a survey is printed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape

from rigctl.analysis.adequacy import chance_text
from rigctl.cli.tables import console, table
from rigctl.survey.result import Line, Survey

#: courses and runs that a terminal shows
_COURSES, _LINES = 4, 24
_HEADS = {
    "changed": "[bold yellow]Changed[/]",
    "no_change_seen": "[bold green]No change seen[/]",
    "cannot_tell": "[bold yellow]Cannot tell[/]",
}


def show_survey(found: Survey, written: Sequence[Path]) -> None:
    """The verdict, the runs with what they say, and what was tested."""
    out = console()
    out.print(f"{_HEADS[found.verdict]}: {escape(found.statement)}.", soft_wrap=True)
    courses = found.shown()[:_COURSES]
    heads = [f"{one.quantity.name} [{one.quantity.unit}]" for one in courses]
    made = table("run", found.axis.name, *map(escape, heads), "agrees")
    for line in _shown(found.lines):
        if line is None:
            made.add_row("…")
        elif line.reading is None:
            made.add_row(line.entry.label, found.axis.text(line.entry), "[yellow]could not be read[/]")
        else:
            values = [found.bare(c.quantity, c.values[line.index], c.std[line.index]) for c in courses]
            agrees = "yes" if line.reading.adequate else "no"
            made.add_row(line.entry.label, found.axis.text(line.entry), *values, agrees)
    out.print(made)
    _show_tests(found)
    for line in found.failed[:5]:
        out.print(f"  [yellow]{escape(line.entry.label)}: {escape(line.failed)}[/]", soft_wrap=True)
    if len(found.failed) > 5:
        out.print(f"  [yellow]and {len(found.failed) - 5} more that could not be read[/]")
    for note in (*found.named.remarks, *found.notes):
        out.print(f"  [dim]{escape(note)}[/]", soft_wrap=True)
    for path in written:
        out.print(f"  written: {escape(path.as_posix())}", soft_wrap=True)


def _shown(lines: Sequence[Line]) -> list[Line | None]:
    """All lines, or the first and the last of them with None between."""
    if len(lines) <= _LINES:
        return list(lines)
    half = _LINES // 2
    return [*lines[:half], None, *lines[-half:]]


def _show_tests(found: Survey) -> None:
    out = console()
    made = table("quantity", "scatter between runs", "chance", "stand apart")
    for one in found.judged.tested[:8]:
        quantity = one.course.quantity
        between = "not known" if one.between is None else found.amount_difference(quantity, one.between)
        chance = "not tested" if one.p_value is None else chance_text(one.p_value)
        apart = ", ".join(found.read[k].entry.label for k in one.apart[:2])
        made.add_row(quantity.name, between, chance, apart)
    out.print(made)
    rest = len(found.judged.tested) - 8
    if rest > 0:
        out.print(f"  and {rest} more, none of them surer", soft_wrap=True)
