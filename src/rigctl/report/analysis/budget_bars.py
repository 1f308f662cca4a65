"""What makes the fitted numbers uncertain, a bar for each."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from rigctl.analysis.uncertainty_budget import READINGS, UncertaintyBudget
from rigctl.report.analysis.bars import Bar
from rigctl.report.section import render
from rigctl.report.signals import plain_name
from rigctl.units import show

#: colours of the noise of the readings, and of everything else in turn
_READINGS, _OTHERS = 7, (0, 1)


def budget_bars(budgets: Sequence[UncertaintyBudget]) -> Markup:
    """A bar for each number, divided by source; empty where all of it is the noise of the readings."""
    if all(len(one.shares) == 1 for one in budgets):
        return Markup()
    return render("budgets.html", budgets=[_row(one) for one in budgets])


def _row(budget: UncertaintyBudget) -> dict[str, object]:
    sources = [source for source in budget.shares if source != READINGS]
    parts = [
        Bar(
            plain_name(source),
            share,
            f"{100.0 * share:.0f} %",
            colour=_READINGS if source == READINGS else _OTHERS[sources.index(source) % len(_OTHERS)],
        )
        for source, share in budget.shares.items()
    ]
    return {
        "name": plain_name(budget.parameter),
        "std": show(budget.std, budget.unit, difference=True, digits=2),
        "parts": parts,
        "text": ", ".join(f"{part.label} {part.text}" for part in parts),
    }
