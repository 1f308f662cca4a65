"""A section of the page, and the templates of all sections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from rigctl.answers import numbers
from rigctl.report.interactive_plots import embed, figure
from rigctl.report.plot import Plot
from rigctl.wording import chance

if TYPE_CHECKING:
    from jinja2 import Environment

    from rigctl.report.heat_map import HeatMap

#: rows of a table that a browser lays out without delay; the page states how many are left out
MOST_ROWS = 1000


@dataclass(frozen=True)
class Section:
    """One part of the page.

    Parameters
    ----------
    id: unique on the page; a link to the section ends with it.
    title: its heading, and its entry in the page's contents.
    body: HTML, from `render`, which escapes everything from a user's file.
    plots: those that are drawn into files if figures are requested.
    folded: only its title and `hint`, a line on its content, are visible until a reader opens it.
    closes: whether it is at the end of the page.
    names_page: the subject of the page, instead of the procedures that were run; "" if it is about the runs.
    """

    id: str
    title: str
    body: Markup
    plots: tuple[Plot | HeatMap, ...] = ()
    folded: bool = False
    hint: str = ""
    closes: bool = False
    names_page: str = ""


def folded(sections: Sequence[Section]) -> list[Section]:
    """The sections, folded, as evidence for another answer on the page."""
    return [replace(one, folded=True) for one in sections]


def render(template: str, **values: Any) -> Markup:
    """A template of this package, filled in; every text is escaped unless it is `Markup` already."""
    return Markup(environment().get_template(template).render(values))  # noqa: S704 - autoescaped


def plot_slot(plot: Plot) -> Markup:
    """Where a plot is drawn once it comes into view, with its numbers beside it."""
    drawn = figure(plot)
    return render("plot.html", plot=plot, height=drawn["height"], content=embed(drawn))


@lru_cache(maxsize=1)
def environment() -> Environment:
    """The templates of the page: escaping by default, and an unknown name is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates", encoding="utf-8"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters.update(
        amount=numbers.amount,
        begun=numbers.begun,
        chance=lambda p_value: numbers.prose(chance(p_value)),
        duration=numbers.duration,
        heading=numbers.heading,
        moment=numbers.moment,
        number=numbers.number,
        prose=numbers.prose,
        resolved=numbers.resolved,
        symbol=numbers.symbol,
        words=numbers.words,
    )
    templates.globals.update(plural=numbers.plural)
    return templates


def cut(rows: Sequence[Any], most: int = MOST_ROWS) -> tuple[Sequence[Any], int]:
    """The rows that are shown, and how many are left out."""
    return rows[:most], max(len(rows) - most, 0)
