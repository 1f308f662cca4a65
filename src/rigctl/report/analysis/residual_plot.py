"""A model's residual analysis as a picture: do the errors follow their own past, or that of an input?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.linear.residual_analysis import Correlations, residual_correlations
from rigctl.model.fit.fit import FitResult
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.signals import plain_name

Floats = NDArray[np.float64]

#: inputs that are drawn for one channel: those that its errors follow most
_MOST_INPUTS = 4
#: colours of the errors' own past, of an input's past, and of the band
_OWN, _INPUT, _BAND = 0, 1, 7


def residual_plots(fit: FitResult) -> list[Plot]:
    """One plot for each channel; none for a table, whose rows have no past."""
    problem = fit.problem
    if problem.measurements.table:
        return []
    titles = problem.measurements.titles
    return [
        _plot(f"residuals-{number}", plain_name(titles.get(name, name)), one, problem.noise.spacing)
        for number, (name, one) in enumerate(residual_correlations(fit).items())
    ]


def _plot(key: str, title: str, found: Correlations, spacing: float) -> Plot:
    """Correlations over the lag in seconds; lag 0 of the autocorrelation, always 1, is left out."""
    lags: Floats = spacing * np.arange(found.auto.size, dtype=np.float64)
    panels = [_panel("their own past", lags[1:], found.auto[1:], found.band, _OWN, named=True)]
    followed = sorted(found.inputs, key=lambda name: found.inputs_p[name])[:_MOST_INPUTS]
    panels += [
        _panel(f"past {plain_name(name)}", lags, found.inputs[name], found.band, _INPUT)
        for name in sorted(followed, key=list(found.inputs).index)
    ]
    return Plot(key, f"Correlation of the errors of {title}", "lag [s]", tuple(panels))


def _panel(
    title: str, lags: Floats, values: Floats, band: float, colour: int, *, named: bool = False
) -> Panel:
    ends = lags[[0, -1]]
    traces = [Trace(f"with {title}", lags, values, Look.MARKED, colour, in_legend=named)]
    for side, label in ((band, "95 % of errors without correlation"), (-band, "")):
        level = np.full(2, side)
        traces.append(Trace(label, ends, level, Look.LINE, _BAND, "", True, named and bool(label)))
    return Panel(f"with {title}", tuple(traces), height=0.8)
