"""The benchmark's figures for people: on a terminal, and in Markdown for the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rigctl_validation.figures import Figures, Rate

if TYPE_CHECKING:
    from rich.table import Table

_HEADINGS = ("what", "of", "share", "95 % bounds", "trials", "target")
_CONFUSED = ("hidden", "found as first", "mistaken for")


def rates_table(figures: Figures) -> Table:
    """The rates as a table for the terminal; met targets are green, missed ones red."""
    from rich.table import Table
    from rich.text import Text

    table = Table(*_HEADINGS)
    colours = {True: "green", False: "red", None: ""}
    for rate in figures.rates:
        row = _row(rate)
        table.add_row(*map(Text, row[:2]), Text(row[2], style=colours[rate.met]), *map(Text, row[3:]))
    return table


def confusion_table(figures: Figures) -> Table:
    """Confusion table of the effects, for the terminal."""
    from rich.table import Table
    from rich.text import Text

    table = Table(*_CONFUSED)
    for row in _confused(figures):
        table.add_row(*map(Text, row))
    return table


def listing_table(figures: Figures) -> Table:
    """The single trials, for the terminal."""
    from rich.table import Table
    from rich.text import Text

    table = Table(*figures.listing[0])
    for row in figures.listing[1:]:
        table.add_row(*map(Text, row))
    return table


def markdown(figures: Figures) -> str:
    """The tables in Markdown."""
    return "\n".join(
        [
            *_markdown(_HEADINGS, [_row(rate) for rate in figures.rates]),
            "",
            *(
                _markdown(figures.listing[0], figures.listing[1:])
                if figures.listing
                else _markdown(_CONFUSED, _confused(figures))
            ),
            "",
        ]
    )


def page(figures: Figures, command: str) -> str:
    """The tables with the command that made them, in Markdown."""
    counted = sum(outcome.counts for outcome in figures.outcomes)
    hours = sum(outcome.seconds for outcome in figures.outcomes) / 3600.0
    lines = [
        f"`{command}`: {counted} trials, {hours:.1f} hours of one core.",
        "",
        markdown(figures),
        *left_out_text(figures),
    ]
    return "\n".join(lines).rstrip() + "\n"


def left_out_text(figures: Figures) -> list[str]:
    """One sentence each for trials that could not be made, and for those that failed."""
    untested = [outcome for outcome in figures.outcomes if outcome.untested]
    failed = [outcome for outcome in figures.outcomes if outcome.failure]
    sentences = []
    if untested:
        names = ", ".join(dict.fromkeys(effect for one in untested for effect in one.scenario.truth))
        count = _trials(len(untested), "could not be made")
        sentences.append(f"{count}, because no amplitude has the size wanted: {names}.")
    if failed:
        sentences.append(f"{_trials(len(failed), 'failed')}, counted as wrong: {failed[0].failure}")
    return sentences


def _row(rate: Rate) -> tuple[str, ...]:
    bounds = f"{_percent(rate.low)} to {_percent(rate.high)}"
    return (rate.name, rate.of, _percent(rate.value), bounds, f"{rate.count} of {rate.trials}", _target(rate))


def _target(rate: Rate) -> str:
    if rate.met is None:
        return ""
    if rate.at_least is not None and rate.at_most is not None:
        wanted = f"{_percent(rate.at_least)} to {_percent(rate.at_most)}"
    elif rate.at_least is not None:
        wanted = f"at least {_percent(rate.at_least)}"
    else:
        wanted = f"at most {_percent(rate.at_most or 0.0)}"
    return f"{wanted}: {'met' if rate.met else 'missed'}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def _confused(figures: Figures) -> list[tuple[str, str, str]]:
    rows = []
    for truth, named in figures.confusion.items():
        right = named.get(truth, 0)
        others = ", ".join(f"{name} {count}" for name, count in named.items() if name != truth)
        rows.append((truth, f"{right} of {sum(named.values())}", others))
    return rows


def _markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    return lines + ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]


def _trials(count: int, what: str) -> str:
    """A number of trials in words, with the singular for one."""
    return f"{count} {'trial' if count == 1 else 'trials'} {what}"
