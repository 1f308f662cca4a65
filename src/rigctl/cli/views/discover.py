"""How the search for a formula is printed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rich.markup import escape
from rich.table import Table

from rigctl.analysis.agreement.adequacy import chance, chance_text
from rigctl.analysis.search.remainder import strength
from rigctl.answers.blocks import Answer, Tone, counted
from rigctl.cli.blocks import show_answer
from rigctl.cli.tables import console, table
from rigctl.cli.terminal_bars import draw_bar
from rigctl.discovery.curve import Curve
from rigctl.discovery.locate import Located
from rigctl.discovery.result import Discovery, FoundFormula
from rigctl.report.braille import draw_curve
from rigctl.units import show, significant

#: places, and lines of a curve, that are shown
_PLACES, _LINES, _WIDTH = 6, 6, 56
#: formulas that the answer names
_FORMULAS = 3


def show_discovery(discovery: Discovery, *, verbose: bool = False) -> None:
    """Show the statement, the location, the size, and each formula in a line; with `verbose` the evidence."""
    tone: Tone = "good" if discovery.gate.reason == "adequate" else "warn"
    title, sentence = discovery.headed
    more = [
        *counted(len(discovery.located[:_PLACES]), "location"),
        *counted(len(discovery.curves[:1]), "curve"),
    ]
    more += [*counted(len(discovery.formulas), "formula"), *counted(len(discovery.notes), "note")]
    shown = () if verbose else tuple(more)
    show_answer(Answer(tone, title, sentence, tuple(_facts(discovery)), more=shown))
    if verbose:
        _show_evidence(discovery)
        return
    for one in discovery.formulas:
        if one.file is not None:
            console().print(f"  written to {escape(one.file.as_posix())}", soft_wrap=True)


def _facts(discovery: Discovery) -> Iterator[tuple[str, str]]:
    """The share of the misfit that a term at the best location explains, and each formula with its check."""
    if discovery.located:
        best = discovery.located[0]
        yield "misfit", f"{100 * best.share:.0f} % of it, {strength(best.size)} ({chance_text(best.p_value)})"
    for one in discovery.formulas[:_FORMULAS]:
        held_out = f", error held out {_held_out(one)}" if _held_out(one) else ""
        accepted = "accepted" if one.accepted else "not accepted"
        sizes = ", ".join(f"{name} {value}" for name, value in one.parameters.items())
        yield "formula", f"{_written(one)}: {sizes}{held_out}; {accepted}"


def _show_evidence(discovery: Discovery) -> None:
    out = console()
    for note in discovery.notes:
        out.print(f"  [dim]{escape(note.text)}[/]", soft_wrap=True)
    if discovery.searched is None:
        return
    out.print(_places(discovery.located[:_PLACES]))
    independent, tests = discovery.searched.independent, discovery.searched.tests
    out.print(
        f"  {tests} terms were tested, equivalent to {independent:.0f} independent tests; "
        f"{discovery.tried} formulas were tried.",
        soft_wrap=True,
    )
    for curve in discovery.curves[:1]:
        _show_curve(curve)
    if discovery.formulas:
        out.print(_formulas(discovery.formulas))
    for one in discovery.formulas:
        _show_formula(one)


def _places(located: Sequence[Located]) -> Table:
    grid = table("a term at", "over", "misfit", "", "sigma", "family-wise p", "equivalent at")
    grid.columns[3].justify = grid.columns[4].justify = "right"
    for one in located:
        grid.add_row(
            escape(one.slot.name),
            escape(" and ".join(driver.name for driver in one.over)),
            f"[cyan]{draw_bar(one.share, 1.0, width=12)}[/]",
            f"{100 * one.share:.0f} %",
            f"{one.size:.1f}",
            chance(one.p_value),
            escape(", ".join(one.alike)),
        )
    return grid


def _show_curve(curve: Curve) -> None:
    """Show the term over its variable, with its band at some points."""
    out = console()
    low, high = float(curve.value.min()), float(curve.value.max())
    unit = curve.slot.unit
    out.print(
        f"  [bold]the term at {escape(curve.slot.name)} over {escape(curve.over)}[/]{_times(curve)}, "
        f"from {show(low, unit, difference=True)} to {show(high, unit, difference=True)}"
    )
    if curve.free:
        out.print(
            "  [dim]apart from a component that the fitted parameters absorb; these data do not determine "
            "its size[/]",
            soft_wrap=True,
        )
    for line in draw_curve(curve.value.tolist(), width=_WIDTH, height=_LINES, low=low, high=high):
        out.print(f"    [cyan]{line}[/]")
    out.print(f"    {show(float(curve.x[0]), curve.shown)} … {show(float(curve.x[-1]), curve.shown)}")
    grid = table(escape(curve.over), "term", "95 % band")
    for index in range(0, curve.x.size, (curve.x.size - 1) // 4):
        ends = (show(float(end[index]), unit, difference=True) for end in (curve.low, curve.high))
        grid.add_row(
            show(float(curve.x[index]), curve.shown),
            show(float(curve.value[index]), unit, difference=True),
            " to ".join(ends),
        )
    out.print(grid)


def _times(curve: Curve) -> str:
    return f" (times {escape(curve.times)})" if curve.times else ""


def _formulas(formulas: Sequence[FoundFormula]) -> Table:
    made = table("formula", "Δ", "tier", "held out", "accepted", "parameters")
    made.columns[1].justify = "right"
    for one in formulas:
        made.add_row(
            escape(one.name),
            f"{one.delta:.1f}",
            one.tier.letter,
            _held_out(one),
            "[green]yes[/]" if one.accepted else "[yellow]no[/]",
            escape(", ".join(f"{name} {value}" for name, value in one.parameters.items())),
        )
    return made


def _held_out(one: FoundFormula) -> str:
    check = one.check
    if check is None or not math.isfinite(check.before):
        return ""
    return f"{significant(check.before)} to {significant(check.after)}"


def _written(one: FoundFormula) -> str:
    """The slot with the formula: ``friction + size*…``; ``orifice*(1 + size*…)`` where terms are factors."""
    if one.fitted.formula.slot.combine == "product":
        return f"{one.slot}*({one.term})"
    return f"{one.slot} + {one.term}"


def _show_formula(one: FoundFormula) -> None:
    out = console()
    out.print(f"  [bold]{escape(one.name)}[/]: {escape(_written(one))}", soft_wrap=True)
    out.print(f"    tier {one.tier.letter}: {escape(one.tier.statement)}", soft_wrap=True)
    if one.passive:
        out.print(f"    it {one.passive}", soft_wrap=True)
    if one.doubt:
        out.print(f"    [yellow]not accepted[/]: {one.doubt}")
    out.print(f"    fitted over {escape(one.valid_text)}; not tested outside this range", soft_wrap=True)
    if one.alike:
        out.print(f"    equivalent in these data: {escape(', '.join(one.alike))}", soft_wrap=True)
    if one.file is not None:
        out.print(f"    written to {escape(one.file.as_posix())}", soft_wrap=True)
