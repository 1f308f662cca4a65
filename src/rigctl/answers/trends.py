"""A trend in words: by how much a quantity changes over a variable, as measured and as modelled."""

from __future__ import annotations

from rigctl.analysis.agreement.trends import LEAST_SHOWN, Trend
from rigctl.units import show, significant


def trend_text(trend: Trend) -> str:
    """Both changes in one clause, with as many digits as show their difference, unless none do."""
    for digits in (2, 3, 4, 2):
        moves, predicted = (_moves(one, digits, trend.unit) for one in (trend.measured, trend.predicted))
        if moves != predicted:
            break
    return f"measured {trend.quantity} {moves} {ends_text(trend)}, the model says it {predicted}"


def ends_text(trend: Trend) -> str:
    """``from 20 degC to 80 degC``."""
    return f"from {show(trend.low, trend.shown, digits=3)} to {show(trend.high, trend.shown, digits=3)}"


def _moves(change: float, digits: int, unit: str) -> str:
    """``rises 4.8 %``, or ``rises 3.2 K``: percentages of an absolute temperature have no meaning."""
    if abs(change) < LEAST_SHOWN[unit]:
        return "stays the same"
    size, shown = (abs(change), "K") if unit == "K" else (abs(change) * 100, "%")
    return f"{'rises' if change > 0.0 else 'falls'} {significant(size, digits)} {shown}"
