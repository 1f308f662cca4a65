"""How a designed experiment is printed."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from rigctl.analysis.decision_levels import ODDS
from rigctl.answers.blocks import Answer, Tone, counted, nonempty
from rigctl.cli.blocks import show_answer
from rigctl.cli.tables import console, table
from rigctl.cli.terminal_bars import draw_bar
from rigctl.design.result import DesignResult, ProposedRecord, SensorSet
from rigctl.design.text import explanations_in_words, share, title
from rigctl.planning.outline import clock_time
from rigctl.units import significant

_WIDTH = 12
#: a probability from which two count as distinguished
_LIKELY = 0.5


def show_design(result: DesignResult, *, verbose: bool = False) -> None:
    """Show the answer, the rivals and the records; with `verbose` also the predictions for each pair and the
    sensors."""
    if verbose:
        _show_whole(result)
        return
    good = result.separable or (result.aim == "precision" and bool(result.records))
    facts = [
        ("either" if not number else "or", text) for number, text in enumerate(explanations_in_words(result))
    ]
    facts += [(f"record {number}", _in_words(one)) for number, one in enumerate(result.records, start=1)]
    probable = {one.name for one in result.rivals if one.weight > 1.0 / ODDS}
    alike = {
        frozenset((one.truth, one.rival)): f"{one.truth} and {one.rival}"
        for one in result.outlooks
        if one.after < _LIKELY and one.truth in probable
    }
    if result.separable and alike:
        facts.append(("hardly", f"distinguished if one of them is right: {', '.join(alike.values())}"))
    more = [
        *(["the predicted power for each pair"] if result.outlooks else []),
        *counted(
            len(result.sharpened),
            "parameter that becomes more certain",
            "parameters that become more certain",
        ),
        *counted(len(result.sensors), "set of sensors", "sets of sensors"),
    ]
    tone: Tone = "good" if good else "warn"
    show_answer(Answer(tone, title(result), result.statement, nonempty(facts), more=tuple(more)))


def _in_words(one: ProposedRecord) -> str:
    """The settings, the steps, the duration, and where the rivals differ most."""
    settings = ", ".join(f"{name} {value}" for name, value in one.settings.items())
    text = f"{settings}: {'; '.join(one.steps)}" if settings else "; ".join(one.steps)
    if one.duration:
        text += f"; {clock_time(one.duration)} of bench time"
    return text if one.widest is None else f"{text}. {one.widest.statement}"


def _show_whole(result: DesignResult) -> None:
    """Show the answer, the rivals, the predictions for each pair, the records and the sensors."""
    out = console()
    good = result.separable or (result.aim == "precision" and bool(result.records))
    out.print(
        f"[bold {'green' if good else 'yellow'}]{title(result)}[/]: {escape(result.statement)}.",
        soft_wrap=True,
    )
    out.print(_rivals(result))
    if result.outlooks:
        out.print(_outlooks(result))
    if result.sharpened:
        out.print(_sharpened(result))
    if result.records:
        out.print(_records(result))
    for number, one in enumerate(result.records, start=1):
        _show_record(number, one)
    if result.sensors:
        out.print(_sensors(result))
    for note in result.notes:
        out.print(f"  [dim]{escape(note)}[/]", soft_wrap=True)


def _rivals(result: DesignResult) -> Table:
    grid = table("rival", "weight", "", "chi²/dof", "parameters")
    grid.columns[2].justify = grid.columns[3].justify = "right"
    for one in result.rivals:
        values = ", ".join(f"{name.partition('.')[2]} {value}" for name, value in one.parameters.items())
        bar = f"[cyan]{draw_bar(one.weight, 1.0, width=_WIDTH)}[/]"
        grid.add_row(
            escape(one.name), bar, f"{100.0 * one.weight:.1f} %", f"{one.chi2_reduced:.3f}", escape(values)
        )
    return grid


def _outlooks(result: DesignResult) -> Table:
    grid = table("if this is right", "rival", "margin so far", "D", "±", "P now", "P after")
    for column in grid.columns[2:]:
        column.justify = "right"
    for one in result.outlooks:
        grid.add_row(
            escape(one.truth),
            escape(one.rival),
            f"{one.margin:+.1f}",
            significant(one.separation, 3),
            significant(one.spread, 2),
            share(one.before),
            share(one.after),
        )
    return grid


def _sharpened(result: DesignResult) -> Table:
    grid = table("parameter", "± now", "± after", "unit")
    grid.columns[1].justify = grid.columns[2].justify = "right"
    for one in result.sharpened:
        grid.add_row(
            escape(one.name), significant(one.before, 3), significant(one.after, 3), escape(one.unit)
        )
    return grid


def _records(result: DesignResult) -> Table:
    precise = result.aim == "precision"
    gain = "ln ratio" if precise else "D"
    grid = table("record", "at", gain, "of a repeat", "P before", "P after", "bench time")
    for column in grid.columns[2:]:
        column.justify = "right"
    for number, one in enumerate(result.records, start=1):
        settings = ", ".join(f"{name} {value}" for name, value in one.settings.items())
        grid.add_row(
            str(number),
            escape(settings),
            significant(one.separation, 3),
            significant(one.of_repeat, 2),
            "" if precise else share(one.before),
            "" if precise else share(one.after),
            clock_time(one.duration) if one.duration else "",
        )
    return grid


def _show_record(number: int, one: ProposedRecord) -> None:
    out = console()
    out.print(f"  {number}: {escape('; '.join(one.steps))}", soft_wrap=True)
    widest = one.widest
    if widest is not None:
        out.print(f"     {escape(widest.statement)}", soft_wrap=True)


def _sensors(result: DesignResult) -> Table:
    grid = table("sensors", "price", "pairs", "D", "P")
    for column in grid.columns[1:]:
        column.justify = "right"
    for one in result.sensors:
        grid.add_row(
            escape(" and ".join(one.channels)),
            price_text(one),
            f"{one.distinguished} of {one.of}",
            significant(one.separation, 3),
            share(one.probability),
        )
    return grid


def price_text(one: SensorSet) -> str:
    """The price of a set of sensors, as stated in the rig file."""
    return "–" if one.price is None else f"{one.price:g} {one.currency}".strip()
