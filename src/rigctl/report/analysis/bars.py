"""Bars of a share or a size, as HTML that prints and needs no script."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from rigctl.report.section import render


@dataclass(frozen=True)
class Bar:
    """One bar: its label, its length as a share of the longest, and the text beside it."""

    label: str
    share: float
    text: str
    note: str = ""
    colour: int = 0

    @property
    def percent(self) -> str:
        """The length in CSS."""
        return f"{100.0 * min(max(self.share, 0.0), 1.0):.1f}%"


def bars(title: str, shown: Sequence[Bar]) -> Markup:
    """A list of bars with a title."""
    return render("bars.html", title=title, bars=shown)
