"""How a designed experiment is printed."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from rigctl.analysis.decision_levels import ODDS
from rigctl.cli.tables import console, table
from rigctl.cli.views.answer import counted, show_answer
from rigctl.design.result import DesignResult, ProposedRecord, SensorSet
from rigctl.design.text import share, title
from rigctl.planning.outline import clock_time
from rigctl.report.answer import Answer
from rigctl.report.terminal_bars import draw_bar
from rigctl.units import significant

_WIDTH = 12
#: a probability from which two count as distinguished
_LIKELY = 0.5


def show_design(found: DesignResult, *, verbose: bool = False) -> None:
    """Show the answer, the rivals and the records; with `verbose` also the predictions for each pair and the
    sensors."""
    if verbose:
        _show_whole(found)
        return
    good = found.separable or (found.aim == "precision" and bool(found.records))
    named = dict(found.explanations.values())
    facts = [("rivals", ", ".join(f"{name} {100.0 * weight:.0f} %" for name, weight in named.items()))]
    facts += [(f"record {number}", _in_words(one)) for number, one in enumerate(found.records, start=1)]
    probable = {one.name for one in found.rivals if one.weight > 1.0 / ODDS}
    alike = {
        frozenset((one.truth, one.rival)): f"{one.truth} and {one.rival}"
        for one in found.outlooks
        if one.after < _LIKELY and one.truth in probable
    }
    if found.records and alike:
        facts.append(("hardly", f"distinguished if one of them is right: {', '.join(alike.values())}"))
    more = [
        *(["the predicted power for each pair"] if found.outlooks else []),
        *counted(
            len(found.sharpened), "parameter that becomes more certain", "parameters that become more certain"
        ),
        *counted(len(found.sensors), "set of sensors", "sets of sensors"),
    ]
    answer = Answer(
        "good" if good else "warn", title(found), found.statement, tuple(f for f in facts if f[1])
    )
    show_answer(answer, more=more)


def _in_words(one: ProposedRecord) -> str:
    """The settings, the steps, the duration, and where the rivals differ most."""
    settings = ", ".join(f"{name} {value}" for name, value in one.settings.items())
    text = f"{settings}: {'; '.join(one.steps)}" if settings else "; ".join(one.steps)
    if one.duration:
        text += f"; {clock_time(one.duration)} of bench time"
    return text if one.widest is None else f"{text}. {one.widest.statement}"


def _show_whole(found: DesignResult) -> None:
    """Show the answer, the rivals, the predictions for each pair, the records and the sensors."""
    out = console()
    good = found.separable or (found.aim == "precision" and bool(found.records))
    out.print(
        f"[bold {'green' if good else 'yellow'}]{title(found)}[/]: {escape(found.statement)}.",
        soft_wrap=True,
    )
    out.print(_rivals(found))
    if found.outlooks:
        out.print(_outlooks(found))
    if found.sharpened:
        out.print(_sharpened(found))
    if found.records:
        out.print(_records(found))
    for number, one in enumerate(found.records, start=1):
        _show_record(number, one)
    if found.sensors:
        out.print(_sensors(found))
    for note in found.notes:
        out.print(f"  [dim]{escape(note)}[/]", soft_wrap=True)


def _rivals(found: DesignResult) -> Table:
    made = table("rival", "weight", "", "chi²/dof", "parameters")
    made.columns[2].justify = made.columns[3].justify = "right"
    for one in found.rivals:
        values = ", ".join(f"{name.partition('.')[2]} {value}" for name, value in one.parameters.items())
        bar = f"[cyan]{draw_bar(one.weight, 1.0, width=_WIDTH)}[/]"
        made.add_row(
            escape(one.name), bar, f"{100.0 * one.weight:.1f} %", f"{one.chi2_reduced:.3f}", escape(values)
        )
    return made


def _outlooks(found: DesignResult) -> Table:
    made = table("if this is right", "rival", "margin so far", "D", "±", "P now", "P then")
    for column in made.columns[2:]:
        column.justify = "right"
    for one in found.outlooks:
        made.add_row(
            escape(one.truth),
            escape(one.rival),
            f"{one.margin:+.1f}",
            significant(one.separation, 3),
            significant(one.spread, 2),
            share(one.before),
            share(one.after),
        )
    return made


def _sharpened(found: DesignResult) -> Table:
    made = table("parameter", "± now", "± then", "unit")
    made.columns[1].justify = made.columns[2].justify = "right"
    for one in found.sharpened:
        made.add_row(
            escape(one.name), significant(one.before, 3), significant(one.after, 3), escape(one.unit)
        )
    return made


def _records(found: DesignResult) -> Table:
    precise = found.aim == "precision"
    gain = "ln ratio" if precise else "D"
    made = table("record", "at", gain, "of a repeat", "P before", "P after", "rig time")
    for column in made.columns[2:]:
        column.justify = "right"
    for number, one in enumerate(found.records, start=1):
        settings = ", ".join(f"{name} {value}" for name, value in one.settings.items())
        made.add_row(
            str(number),
            escape(settings),
            significant(one.separation, 3),
            significant(one.of_repeat, 2),
            "" if precise else share(one.before),
            "" if precise else share(one.after),
            clock_time(one.duration) if one.duration else "",
        )
    return made


def _show_record(number: int, one: ProposedRecord) -> None:
    out = console()
    out.print(f"  {number}: {escape('; '.join(one.steps))}", soft_wrap=True)
    widest = one.widest
    if widest is not None:
        out.print(f"     {escape(widest.statement)}", soft_wrap=True)


def _sensors(found: DesignResult) -> Table:
    made = table("sensors", "price", "pairs", "D", "P")
    for column in made.columns[1:]:
        column.justify = "right"
    for one in found.sensors:
        made.add_row(
            escape(" and ".join(one.channels)),
            price_text(one),
            f"{one.distinguished} of {one.of}",
            significant(one.separation, 3),
            share(one.probability),
        )
    return made


def price_text(one: SensorSet) -> str:
    """The price of a set of sensors, as stated in the rig file."""
    return "–" if one.price is None else f"{one.price:g} {one.currency}".strip()
