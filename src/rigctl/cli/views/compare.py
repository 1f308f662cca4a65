"""How a comparison is printed."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from rigctl.analysis.adequacy import chance
from rigctl.analysis.comparison_result import Comparison, ModelComparison
from rigctl.analysis.fmu_rival import FmuRival
from rigctl.analysis.localisation import Place
from rigctl.cli.tables import console, table
from rigctl.cli.views.answer import counted, show_answer, show_first
from rigctl.cli.views.table import show_rows
from rigctl.model.validity import Departure
from rigctl.report.answer import models_answer, noise_known_from
from rigctl.report.numbers import resolved
from rigctl.report.terminal_bars import draw_bar
from rigctl.units import significant

_ASKS = {
    "score": "does any effect of the library stand out?",
    "plane": "does the error change with the operating point?",
    "chi2": "is the whole misfit more than noise?",
    "inputs": "does the error follow the past of an input?",
}
_KINDS = {
    "channel": "channel",
    "phase": "phase",
    "cell": "channel and phase",
    "condition": "condition",
    "state": "range of a channel",
    "stretch": "worst stretches",
}
_MOST = {"condition": 5, "state": 3, "stretch": 3, "cell": 5}
_BAR = 16
#: findings on the values of a table that are shown without `-v`
_MOST_FINDINGS = 2


def show_fmu_rivals(rivals: Sequence[FmuRival]) -> None:
    """Show the errors of each FMU and of the model, channel by channel, and which is smaller."""
    out = console()
    for rival in rivals:
        out.print()
        out.print(f"{escape(rival.statement)}.", soft_wrap=True)
        for name in rival.missing:
            out.print(f"  {escape(name)} is not an output of {escape(rival.name)}: it is not compared")
        for name in rival.own_initial_values:
            out.print(
                f"  the initial value of {escape(name)} cannot be set in {escape(rival.name)}: "
                "its own is used",
                soft_wrap=True,
            )
        shown = table("channel", "RMSE/noise of the FMU", "of the model")
        for name, error in rival.channels.items():
            shown.add_row(name, significant(error.nrmse, 3), significant(rival.beside[name].nrmse, 3))
        out.print(shown)


def show_comparison(comparison: Comparison, *, verbose: bool = False) -> None:
    """Show the statement on each model and the next command; with `verbose` the figures behind it."""
    if verbose:
        _show_evidence(comparison)
        return
    for model in comparison.models[:-1]:
        show_statement(model)
    last = comparison.models[-1]
    more = [
        *counted(len(routine(comparison.notes)), "note on the data", "notes on the data"),
        "all tests and locations",
    ]
    show_answer(models_answer(comparison.models), title="-", more=more)
    for model in comparison.models:
        show_departures(model.outside)
        for band in model.curve_bands:
            console().print(f"  {escape(band.statement)}.", soft_wrap=True)
    show_unusual(comparison.notes)
    for finding in last.findings[:_MOST_FINDINGS]:
        console().print(f"  {escape(finding)}.", soft_wrap=True)


#: a note on the spikes of one channel
_SPIKES = re.compile(r"^\d+ spikes? of \w+ (was|were) masked: ")
#: beginnings or parts of notes that every comparison has about how its data were taken, or that repeat
#: the line on the error
_ROUTINE = (
    "Noise: ",
    "Noise of ",
    "assumed of ",
    "Commands were written down",
    " masked: ",
    " is only guessed: ",
)


def routine(notes: Sequence[str]) -> list[str]:
    """The notes that only describe how the data were taken, which every answer would repeat."""
    return [note for note in notes if any(part in note for part in _ROUTINE)]


def show_notes(notes: Sequence[str]) -> None:
    """Show the notes except those on spikes, which the note on the noise and the table of channels state."""
    for note in notes:
        if not re.search(_SPIKES, note):
            console().print(f"  [dim]{escape(note)}[/]", soft_wrap=True)


def show_unusual(notes: Sequence[str]) -> None:
    """The other notes: those that a reader has to know before trusting a verdict."""
    for note in notes:
        if note not in routine(notes):
            console().print(f"  [dim]{escape(note)}[/]", soft_wrap=True)


def _show_evidence(comparison: Comparison) -> None:
    """Show the statement on each model, and every figure behind it."""
    out = console()
    for model in comparison.models:
        show_statement(model)
        show_departures(model.outside)
        for band in model.curve_bands:
            out.print(f"  {escape(band.statement)}.", soft_wrap=True)
        for finding in model.findings:
            out.print(f"  {escape(finding)}.", soft_wrap=True)
    show_notes(comparison.notes)
    if comparison.held_out:
        out.print(f"  held out: {len(comparison.held_out)} records ({escape(_few(comparison.held_out))})")
    if len(comparison.models) > 1:
        out.print(_side_by_side(comparison.models))
        return
    (model,) = comparison.models
    if model.rows:
        show_rows(model)
    out.print(_channels(model))
    out.print(_tests(model))
    show_record_level(model)
    for line in model.in_brief:
        out.print(f"  {escape(line)}", soft_wrap=True)
    for line in model.decided_by:
        out.print(f"  decided by: {escape(line)}", soft_wrap=True)
    if not model.adequate:
        places = [place for place in model.where if place.by == "condition"] if model.rows else model.where
        out.print(_places(places))
        _show_trends(model)
        _show_slots(model)


def show_statement(model: ModelComparison) -> None:
    """Show a comparison's one-sentence result: green if it agrees, grey if these data cannot tell."""
    colour = {True: "green", False: "red", None: "bright_black"}[model.adequacy.verdict]
    show_first(model.first)
    console().print(f"[bold {colour}]{escape(model.statement)}[/]", soft_wrap=True)


def show_departures(departures: Sequence[Departure]) -> None:
    """Show a warning for each range of validity that the model leaves."""
    for one in departures:
        console().print(f"  [yellow]warning:[/] {escape(one.statement)}.", soft_wrap=True)


def show_record_level(model: ModelComparison) -> None:
    """Show the record-level parameters, by quantity, and which of them are suspicious."""
    out = console()
    if not model.record_level:
        return
    grid = table("record-level parameter", "prior", "lowest", "mean", "highest", "records")
    for column in grid.columns[2:]:
        column.justify = "right"
    for one in model.record_level:
        values = one.values
        mark = "[red]" if one.statement else ""
        cells = [one.shown(float(value)) for value in (values.min(), values.mean(), values.max())]
        grid.add_row(f"{mark}{escape(one.meaning)}", escape(one.prior), *map(escape, cells), str(values.size))
    out.print(grid)
    for one in model.record_level:
        if one.statement and one.statement not in model.statement:
            text = one.statement[0].upper() + one.statement[1:]
            out.print(f"  {escape(text)}.", soft_wrap=True)


def _few(labels: Sequence[str], most: int = 6) -> str:
    more = len(labels) - most
    return ", ".join(labels[:most]) + (f" and {more} more" if more > 0 else "")


def _channels(model: ModelComparison) -> Table:
    """Model less measurement, channel by channel."""
    channels = model.channels()
    held = any(one["heldout_rmse"] is not None for one in channels.values())
    heads = ("channel", "RMSE", *(["held out"] if held else []), "bias", "largest", "noise", "unit")
    grid = table(*heads, "RMSE/noise", "χ²", "R²", "noise from", "spikes masked")
    for column in grid.columns[1 : len(heads) - 1]:
        column.justify = "right"
    titles = model.fit.problem.measurements.titles
    for name, one in channels.items():
        rest = [_shown(one["heldout_rmse"], ".4g")] if held else []
        share = one["noise_share"]
        grid.add_row(
            titles.get(name, name),
            significant(one["rmse"]),
            *rest,
            significant(resolved(one["bias"], one["rmse"]), 2, sign=True),
            significant(one["max"], 3, sign=True),
            f"{significant(100 * share, 2)} %" if share else significant(one["noise"], 3),
            escape(one["unit"]),
            f"{one['nrmse']:.3f}",
            "" if one["noise_source"] == "floor" else f"{one['chi2_reduced']:.3f}",
            _shown(one["r2"], ".5f"),
            noise_known_from(one),
            str(one["masked"] or ""),
        )
    return grid


def _shown(value: float | None, form: str) -> str:
    return "" if value is None else f"{value:{form}}"


def _side_by_side(models: Sequence[ModelComparison]) -> Table:
    """One column for each model."""
    grid = table("", *(escape(model.name) for model in models))
    channels = [model.channels() for model in models]
    for name in dict.fromkeys(name for by_name in channels for name in by_name):
        grid.add_row(f"[bold]{name}[/]")
        for label, key in (("RMSE", "rmse"), ("held out", "heldout_rmse"), ("noise", "noise")):
            cells = [by_name[name][key] if name in by_name else None for by_name in channels]
            units = [by_name[name]["unit"] if name in by_name else "" for by_name in channels]
            if any(cell is not None for cell in cells):
                shown = [
                    "" if cell is None else f"{significant(cell)} {escape(unit)}"
                    for cell, unit in zip(cells, units, strict=True)
                ]
                grid.add_row(f"  {label}", *shown)
    if not any(model.fit.problem.noise.own_scale for model in models):
        grid.add_row("reduced χ²", *(significant(model.fit.chi2_reduced) for model in models))
    for test in _ASKS:
        tests = [model.adequacy.tests.get(test) for model in models]
        if any(tests):
            grid.add_row(f"p of {test} test", *("" if one is None else chance(one.p_value) for one in tests))
    grid.add_row("p of all", *(chance(model.adequacy.p_value) for model in models))
    grid.add_row("adequate", *map(_adequate, models))
    return grid


def _adequate(model: ModelComparison) -> str:
    words = {True: "[green]yes[/]", False: "[red]no[/]", None: "[bright_black]cannot tell[/]"}
    return words[model.adequacy.verdict]


def _tests(model: ModelComparison) -> Table:
    grid = table("test", "what it asks", "statistic", "dof", "p")
    for name, test in model.adequacy.tests.items():
        dof = str(test.dof) if test.dof else ""
        grid.add_row(name, _ASKS.get(name, ""), significant(test.statistic), dof, chance(test.p_value))
    count = len(model.adequacy.tests)
    grid.add_row("all", f"Holm: the smallest p times {count}", "", "", chance(model.adequacy.p_value))
    return grid


def _places(places: Sequence[Place]) -> Table:
    """Show where it fails, the worst of each kind first."""
    grid = table("where it fails", "share of the error", "", "error/noise", "p")
    grid.columns[2].justify = "right"
    kinds = list(dict.fromkeys(place.by for place in places))
    if "phase" not in kinds:  # with a single phase, the channel names suffice
        kinds = [kind for kind in kinds if kind != "cell"]
    for kind in kinds:
        group = [place for place in places if place.by == kind]
        grid.add_row(f"[dim]by {_KINDS[kind]}[/]")
        for place in group[: _MOST.get(kind, len(group))]:
            share = max(place.share_of_error, 0.0)
            grid.add_row(
                f"  {escape(place.label)}",
                f"[cyan]{draw_bar(share, 1.0, width=_BAR)}[/]",
                f"{100 * share:.0f} %",
                f"{place.rmse:.2f}",
                chance(place.p_value),
            )
    return grid


def _show_trends(model: ModelComparison) -> None:
    out = console()
    shown = [trend for trend in model.trends if trend.significant][:6]
    if not shown:
        return
    out.print("  [bold]trends over the operating variables[/]")
    for trend in shown:
        wrong = ": [red]the wrong direction[/]" if trend.wrong_sign and trend.matters else ""
        out.print(f"  {escape(trend.text)} ({abs(trend.z):.0f} sigma){wrong}", soft_wrap=True)


def _show_slots(model: ModelComparison) -> None:
    out = console()
    shown = [slot for slot in model.slots if slot.log_evidence > 0.0][:6]
    if not shown:
        return
    if model.rows and len(shown[0].alike) > 1:
        alike = ", ".join((shown[0].slot, *shown[0].alike))
        out.print(f"  single values do not show which equation lacks a term: {escape(alike)}", soft_wrap=True)
        return
    out.print("  [bold]which equation lacks a term[/], log-evidence")
    width = max(len(slot.slot) for slot in shown)
    for slot in shown:
        bar = draw_bar(slot.log_evidence, shown[0].log_evidence, width=2 * _BAR)
        out.print(
            f"  {escape(slot.slot):<{width}}  [cyan]{bar}[/] {significant(slot.log_evidence)}", soft_wrap=True
        )
