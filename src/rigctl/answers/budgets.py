"""What makes the fitted numbers uncertain, a bar for each."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.analysis.agreement.uncertainty_budget import READINGS, UncertaintyBudget
from rigctl.answers.blocks import Bar, Bars
from rigctl.units import show

#: colours of the noise of the readings, and of everything else in turn
_READINGS, _OTHERS = 7, (0, 1)


def budget_bars(budgets: Sequence[UncertaintyBudget]) -> list[Bars]:
    """A bar for each number, divided by source; none where all of it is the noise of the readings."""
    if all(len(one.shares) == 1 for one in budgets):
        return []
    title = "what makes the fitted numbers uncertain: shares of the variance of each"
    return [Bars(title, tuple(map(_bar, budgets)))]


def _bar(budget: UncertaintyBudget) -> Bar:
    sources = [source for source in budget.shares if source != READINGS]
    parts = tuple(
        Bar(
            source,
            share,
            f"{100.0 * share:.0f} %",
            colour=_READINGS if source == READINGS else _OTHERS[sources.index(source) % len(_OTHERS)],
        )
        for source, share in budget.shares.items()
    )
    std = show(budget.std, budget.unit, difference=True, digits=2)
    text = ", ".join(f"{part.label} {part.text}" for part in parts)
    return Bar(f"{budget.parameter}, ±{std}", 1.0, text, parts=parts)
