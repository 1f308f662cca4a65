"""The section on laws: the assumed term, and the one estimated from the data with its band."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.analysis.laws.answer import LawAnswer
from rigctl.answers.diagnosis import drawn_laws, law_figures
from rigctl.answers.numbers import symbol
from rigctl.report.plot import Panel, Plot, Trace
from rigctl.report.signals import plain_name


def law_plots(laws: Sequence[LawAnswer]) -> list[Plot]:
    """A curve for each law; none for a term that has no value over its range."""
    return [
        _plot(one, key, caption)
        for one, (key, caption) in zip(drawn_laws(laws), law_figures(laws), strict=True)
    ]


def _plot(one: LawAnswer, key: str, caption: str) -> Plot:
    law, unit = one.law, symbol(one.value_unit)
    traces = (
        Trace("assumed", one.x, one.assumed, colour=7, unit=unit),
        Trace("estimated from the data", one.x, law.asked, colour=0, unit=unit),
        Trace("95 % band", one.x, law.low, colour=0, unit=unit, faint=True),
        Trace("", one.x, law.high, colour=0, unit=unit, faint=True, in_legend=False),
    )
    driver = plain_name(law.driver.name)
    panel = Panel(f"{plain_name(law.slot)} [{unit}]", traces, height=1.4)
    return Plot(key, caption, f"{driver} [{symbol(one.unit)}]", (panel,))
