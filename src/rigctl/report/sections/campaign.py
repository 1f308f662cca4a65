"""Results over the swept variables: stroke against temperature for each pressure, with the table of
values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.answers.numbers import MISSING, amount, decimals, fixed, number, setting, symbol
from rigctl.report.responses import Point, Response, response_plot, responses
from rigctl.report.run_data import RunData
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name


@dataclass(frozen=True)
class Cell:
    """One operating point in the table: its mean, and the text beside it."""

    value: str
    spread: str  #: of the replicates
    change: str  #: to the first row


def build(runs: Sequence[RunData]) -> Section | None:
    """A plot and a table for each result; None when nothing was swept."""
    parts = []
    plots = []
    for index, response in enumerate(responses(runs)):
        plot = response_plot(response, f"response-{index}")
        plots.append(plot)
        parts.append(
            {
                "title": plot.caption,
                "sentence": sentence(response),
                "origin": response.origin,
                "slot": plot_slot(plot),
                "head": f"{response.x_title} [{symbol(response.x_unit) or '1'}]",
                "unit": symbol(response.unit),
                "labels": [one.label for one in response.series],
                "rows": table(response),
            }
        )
    if not parts:
        return None
    hint = ", ".join(str(part["title"]) for part in parts)
    return Section("campaign", "Results", render("campaign.html", parts=parts), tuple(plots), hint=hint)


def sentence(response: Response) -> str:
    """The largest change over x in words."""
    largest = response.largest_change()
    if largest is None:
        return ""
    one, first, last = largest
    change = last.mean - first.mean
    if change == 0.0:
        return f"The {plain_name(response.name)} does not change with {response.x_title}."
    share = f" ({number(100.0 * change / abs(first.mean), 2)} %)" if first.mean else ""
    where = f" at {one.label}" if len(response.series) > 1 else ""
    return (
        f"Largest change with {response.x_title}: the {plain_name(response.name)} "
        f"{'rises' if change > 0 else 'falls'} by {amount(abs(change), response.unit, 3)}"
        f"{share.replace('−', '')}{where}, from {amount(first.x, response.x_unit)} "
        f"to {amount(last.x, response.x_unit)}."
    )


def table(response: Response) -> list[tuple[str, list[Cell]]]:
    """One row per x, one cell per series."""
    means = [point.mean for one in response.series for point in one.points]
    digits = decimals(means)
    firsts = [one.points[0] for one in response.series]
    return [
        (
            setting(x),
            [_cell(one.at(x), first, digits) for one, first in zip(response.series, firsts, strict=True)],
        )
        for x in response.xs
    ]


def _cell(point: Point | None, first: Point, digits: int) -> Cell:
    if point is None:
        return Cell(MISSING, "", "")
    spread = "" if point.spread is None else f"± {fixed(point.spread, digits)} (n = {len(point.values)})"
    change = "" if point.x == first.x else fixed(point.mean - first.mean, digits, sign=True)
    return Cell(fixed(point.mean, digits), spread, change)
