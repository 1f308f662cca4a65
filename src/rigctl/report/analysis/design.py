"""The section on the next experiment: the predictions of the rivals, and the predicted power."""

from __future__ import annotations

import numpy as np

from rigctl.answers.design.design import design_page, record_caption
from rigctl.answers.numbers import symbol
from rigctl.design.result import DesignResult, Prediction, SensorSet
from rigctl.report.blocks import page_blocks
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import Section, plot_slot, render
from rigctl.report.signals import plain_name

#: rivals that are drawn, the most probable first
_DRAWN = 4
#: a channel in which none of them differ by more, in sigmas, does not distinguish them
_SHOWS = 0.5


def design_sections(result: DesignResult) -> list[Section]:
    """The answer, the rivals, the records with what each rival predicts, the sensors, the procedure."""
    plots = [  # a row of a table has no time series
        record_plot(result, number) for number, record in enumerate(result.records) if record.predictions
    ]
    chart = sensor_plot(result.sensors)
    drawn = (*plots, *([] if chart is None else [chart]))
    body = page_blocks(design_page(result), {plot.id: plot_slot(plot) for plot in drawn})
    if result.procedure:
        body += render("procedure.html", procedure=result.procedure)
    return [Section("next-experiment", "What to measure next", body, drawn)]


def record_plot(result: DesignResult, number: int) -> Plot:
    """The rivals' predictions of a record, with the noise of a reading around the first."""
    record = result.records[number]
    names = [one.name for one in result.rivals][:_DRAWN]
    shown = [one for one in record.predictions if _differs(one, names)] or list(record.predictions[-1:])
    panels = [_panel(one, names, named=k == 0) for k, one in enumerate(shown)]
    if len(names) > 1:
        panels += [_apart(one, names) for one in shown]
    return Plot(
        f"next-{number + 1}", record_caption(record, number + 1), "time in the record [s]", tuple(panels)
    )


def _differs(one: Prediction, names: list[str]) -> bool:
    first = one.by_rival[names[0]]
    return any(float(np.max(np.abs(one.by_rival[name] - first) / one.sigma)) > _SHOWS for name in names[1:])


def _panel(one: Prediction, names: list[str], *, named: bool) -> Panel:
    unit = symbol(one.unit)
    traces = [
        Trace(plain_name(name), one.times, one.by_rival[name], Look.LINE, k, unit, False, named)
        for k, name in enumerate(names)
    ]
    first, band = one.by_rival[names[0]], 2.0 * one.sigma
    traces.append(
        Trace("± twice the noise of a reading", one.times, first + band, Look.LINE, 0, unit, True, named)
    )
    traces.append(Trace("", one.times, first - band, Look.LINE, 0, unit, True, False))
    return Panel(f"{plain_name(one.channel)} [{unit}]", tuple(traces), height=1.2)


def _apart(one: Prediction, names: list[str]) -> Panel:
    """The predictions of the other rivals less that of the first, in units of the noise."""
    first = one.by_rival[names[0]]
    traces = tuple(
        Trace(
            plain_name(name),
            one.times,
            (one.by_rival[name] - first) / one.sigma,
            Look.LINE,
            k,
            "times the noise",
            False,
            False,
        )
        for k, name in enumerate(names)
        if k
    )
    return Panel(
        f"{plain_name(one.channel)}, less {plain_name(names[0])} [times the noise]", traces, height=1.0
    )


def sensor_plot(sensors: tuple[SensorSet, ...]) -> Plot | None:
    """Number of distinguished pairs over the price of the sensors; the line joins the best for each price."""
    priced = sorted((one for one in sensors if one.price is not None), key=lambda one: one.price or 0.0)
    if not priced:
        return None
    currency = priced[0].currency
    front: list[SensorSet] = []
    for one in priced:
        if not front or (one.distinguished, one.probability) > (
            front[-1].distinguished,
            front[-1].probability,
        ):
            front.append(one)
    traces = [
        Trace("best value for money", *_points(front), Look.MARKED, 0),
        *(
            Trace(" and ".join(map(plain_name, one.channels)), *_points([one]), Look.POINTS, 1 + k % 6)
            for k, one in enumerate(priced)
        ),
    ]
    caption = "Pairs distinguished with a probability of at least a half, over the price of the sensors"
    panel = Panel("pairs distinguished", tuple(traces), 1.6)
    return Plot("sensors", caption, f"price [{currency}]", (panel,))


def _points(sets: list[SensorSet]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([one.price or 0.0 for one in sets]), np.array([float(one.distinguished) for one in sets])
