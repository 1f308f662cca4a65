"""The section on laws: the assumed term, and the one estimated from the data with its band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.analysis.laws.answer import LawAnswer
from rigctl.report.numbers import symbol
from rigctl.report.plot import Panel, Plot, Trace
from rigctl.report.signals import plain_name

#: curves that are drawn, those that differ from the assumed ones first
_MOST = 4


def law_plots(laws: Sequence[LawAnswer]) -> list[Plot]:
    """A curve for each law; none for a term that has no value over its range."""
    drawn = [one for one in laws if np.isfinite(one.law.asked).all() and np.isfinite(one.assumed).all()]
    drawn.sort(key=lambda one: not one.differs)
    return [_plot(one, number) for number, one in enumerate(drawn[:_MOST])]


def _plot(one: LawAnswer, number: int) -> Plot:
    law, unit = one.law, symbol(one.value_unit)
    traces = (
        Trace("assumed", one.x, one.assumed, colour=7, unit=unit),
        Trace("estimated from the data", one.x, law.asked, colour=0, unit=unit),
        Trace("95 % band", one.x, law.low, colour=0, unit=unit, faint=True),
        Trace("", one.x, law.high, colour=0, unit=unit, faint=True, in_legend=False),
    )
    driver = plain_name(law.driver.name)
    panel = Panel(f"{plain_name(law.slot)} [{unit}]", traces, height=1.4)
    caption = f"{plain_name(one.effect)} over {driver}: the assumed law, and the one estimated from the data"
    return Plot(f"law-{number}", caption, f"{driver} [{symbol(one.unit)}]", (panel,))
