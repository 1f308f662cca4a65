"""The whole run over time: heating phases, records, alarms."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.report.run_data import RunData
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import overview_plot

_POINTS = 2500


def build(runs: Sequence[RunData]) -> Section | None:
    """One plot per run; None when no run has samples."""
    plots = [
        overview_plot(run, points=_POINTS, key=f"overview-{number}")
        for number, run in enumerate(runs)
        if len(run.time)
    ]
    if not plots:
        return None
    parts = [{"caption": plot.caption, "slot": plot_slot(plot)} for plot in plots]
    body = render("overview.html", parts=parts, several=len(plots) > 1)
    name = "The whole run" if len(plots) == 1 else "The whole runs"
    return Section("overview", name, body, tuple(plots), folded=True, hint="every sample from start to end")
