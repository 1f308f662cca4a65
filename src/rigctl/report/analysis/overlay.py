"""Measurement and model in one plot with the noise band, and the residuals.

In: one or two models fitted to the same records, and the record to be drawn. Out: a `Plot`. `fall_plot`
is for the top of a page: a few channels, before and after, each with its residuals. `overlay_plot` is for
the sections below: every channel of a record.

Long records are drawn with every so many samples, residuals in sigmas of one reading. Ten thousand
readings can show an error that is far smaller than the noise of one; drawn as they are, nothing of it
would be seen. Such residuals are drawn as running means, in a band that is as narrow as the mean of
correlated readings is certain.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.answers.numbers import symbol
from rigctl.model.curve_bands import CurveBand, combined
from rigctl.model.fit.fit import FitResult
from rigctl.noise import ChannelNoise
from rigctl.report.plot import Look, Panel, Plot, Span, Trace
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

_MOST_POINTS = 1500
#: colours of residuals, different from those of two models
_AFTER_MODELS = 2


def typical_records(fit: FitResult) -> tuple[tuple[str, int], ...]:
    """(description, index) of the worst, the middle and the best record."""
    sizes = [float(np.sqrt(np.nanmean(fit.normalised_error(k) ** 2))) for k in range(len(fit.outputs))]
    order = sorted(range(len(sizes)), key=lambda k: -sizes[k])
    chosen = {order[0]: "the worst record"}
    if len(order) > 2:
        chosen.setdefault(order[len(order) // 2], "a typical record")
    if len(order) > 1:
        chosen.setdefault(order[-1], "the best record")
    return tuple((name, k) for k, name in chosen.items())


def condition_of(fit: FitResult, k: int) -> str:
    """The operating point of a record, or its name."""
    from rigctl.model.measured.conditions import condition_text, variable_units

    record = fit.problem.records[k]
    return condition_text(record.condition, variable_units(fit.problem.measurements)) or record.label


def fall_plot(
    models: Sequence[tuple[str, FitResult]], k: int, key: str, caption: str, channels: Sequence[str]
) -> Plot:
    """One record of some channels, measured and of one or two models, with the residuals below it.

    `models` are names and the predictions of the same records. Residuals are in sigmas of one reading, with
    the band that contains 95 % of pure noise. If they are smaller than the noise of one reading, means
    of several readings are drawn, in which the noise averages out.
    """
    problem = models[0][1].problem
    record, outputs = problem.records[k], problem.measurements.outputs
    rows = np.unique(np.linspace(0, record.times.size - 1, min(record.times.size, _MOST_POINTS)).astype(int))
    times = record.times[rows]
    count = _averaged(models, k, [outputs.index(name) for name in channels])
    panels: list[Panel] = []
    for name in channels:
        c = outputs.index(name)
        panels.append(_curves(models, k, c, rows, times, named=not panels))
        panels.append(_left(models, k, c, rows, times, count, named=len(panels) == 1))
    if count > 1:
        caption += f"; below it the residuals, as means of {count} readings"
    return Plot(key, caption, "time in the record [s]", tuple(panels), _spans(record.times, record.phase))


def _averaged(models: Sequence[tuple[str, FitResult]], k: int, columns: Sequence[int]) -> int:
    """The number of readings in each mean: one if the residuals of the first model are visible without
    averaging."""
    first, last = models[0][1], models[-1][1]
    error = first.normalised_error(k)[:, columns]
    if len(models) > 1:
        error = error - last.normalised_error(k)[:, columns]
    elif np.nanmean(error**2) > _SEEN**2 + 1.0:
        return 1
    if len(models) > 1 and np.nanmean(error**2) > _SEEN**2:
        return 1
    return int(np.clip(error.shape[0] // _MEANS, 1, _MOST_AVERAGED)) | 1


def running_mean(values: Floats, phase: NDArray[np.intp], count: int) -> Floats:
    """(n) the mean of `count` present values around each, within its phase."""
    if count < 2:
        return values
    means = np.full(values.shape, np.nan)
    window = np.ones(count)
    for number in np.unique(phase):
        inside = phase == number
        segment = values[inside]
        known = np.isfinite(segment)
        sums = np.convolve(np.where(known, segment, 0.0), window)
        counts = np.convolve(known.astype(float), window)
        middle = slice(count // 2, count // 2 + segment.size)
        with np.errstate(invalid="ignore"):
            means[inside] = np.where(counts[middle] > 0.0, sums[middle] / counts[middle], np.nan)
    return means


#: root mean square in sigmas from which residuals are visible without averaging
_SEEN = 1.0
#: number of means along a record, and the most readings in each
_MEANS, _MOST_AVERAGED = 50, 50
#: colours of the first and the last model: orange and blue
_OF_MODELS = (1, 0)


def _curves(
    models: Sequence[tuple[str, FitResult]],
    k: int,
    c: int,
    rows: NDArray[np.intp],
    times: Floats,
    *,
    named: bool,
) -> Panel:
    problem = models[0][1].problem
    measurements = problem.measurements
    unit, shown = parse_unit(measurements.units[c]), symbol(measurements.units[c])
    value = problem.records[k].values[rows, c]
    measured = np.where(problem.ok[k][rows, c], (value - unit.offset) / unit.factor, np.nan)
    traces = [Trace("measured", times, measured, colour=7, unit=shown, in_legend=named)]
    for (name, fit), colour in zip(models, _OF_MODELS, strict=False):
        prediction = (fit.outputs[k][rows, c] - unit.offset) / unit.factor
        traces.append(Trace(name, times, prediction, colour=colour, unit=shown, in_legend=named))
    return Panel(f"{plain_name(measurements.outputs[c])} [{shown}]", tuple(traces), height=1.1)


def _left(
    models: Sequence[tuple[str, FitResult]],
    k: int,
    c: int,
    rows: NDArray[np.intp],
    times: Floats,
    count: int,
    *,
    named: bool,
) -> Panel:
    problem = models[0][1].problem
    output = problem.measurements.outputs[c]
    (noise,) = (one for one in problem.noise.channels if one.name == output)
    traces = []
    for (name, fit), colour in zip(models, _OF_MODELS, strict=False):
        error = running_mean(fit.normalised_error(k)[:, c], problem.records[k].phase, count)[rows]
        traces.append(
            Trace(f"{name} − measured", times, error, Look.LINE, colour, "times the noise", in_legend=False)
        )
    ends = np.array([float(times[0]), float(times[-1])])
    band = 2.0 * _spread_of_mean(noise, count)
    for side, label in ((band, "95 % of pure noise"), (-band, "")):
        level = np.full(2, side)
        traces.append(Trace(label, ends, level, Look.LINE, 7, "times the noise", True, named and bool(label)))
    return Panel("model − measured [σ]", tuple(traces), height=1.2)


def _spread_of_mean(noise: ChannelNoise, count: int) -> float:
    """Standard deviation of the mean of neighbouring readings, in sigmas of one."""
    shared = (1.0 - noise.white) * noise.correlation ** np.arange(1, count)
    return float(np.sqrt((1.0 + 2.0 * np.sum((1.0 - np.arange(1, count) / count) * shared)) / count))


def overlay_plot(
    models: Sequence[tuple[str, FitResult]],
    k: int,
    key: str,
    caption: str,
    curve_bands: Sequence[CurveBand] = (),
) -> Plot:
    """One record: every channel with its noise band and the models, and the residuals in sigmas below.

    `models` are names and the predictions of the same records; band and residuals are those of the first one.
    `curve_bands` belong to it too, and widen the band.
    """
    problem = models[0][1].problem
    record = problem.records[k]
    rows = np.unique(np.linspace(0, record.times.size - 1, min(record.times.size, _MOST_POINTS)).astype(int))
    columns = [c for c in range(len(problem.measurements.outputs)) if problem.ok[k][rows, c].any()]
    times = record.times[rows]  # computed once, so that the page contains data shared by traces only once
    extra = [combined(curve_bands, problem.measurements.outputs[c], k) for c in columns]
    panels = [
        _channel_panel(models, k, c, rows, times, None if more is None else more[rows], named=c == columns[0])
        for c, more in zip(columns, extra, strict=True)
    ]
    error = models[0][1].normalised_error(k)[rows]
    residuals = [
        Trace(
            plain_name(problem.measurements.outputs[c]),
            times,
            error[:, c],
            colour=c + _AFTER_MODELS,
            unit="times the noise",
        )
        for c in columns
    ]
    panels.append(Panel("model − measured [times the noise]", tuple(residuals), height=1.2))
    return Plot(key, caption, "time in the record [s]", tuple(panels), _spans(record.times, record.phase))


def _channel_panel(
    models: Sequence[tuple[str, FitResult]],
    k: int,
    c: int,
    rows: NDArray[np.intp],
    times: Floats,
    extra: Floats | None,
    *,
    named: bool,
) -> Panel:
    """One channel, measured and of every model; `named` says whether its lines are in the legend,
    `extra` (rows) is what half the band is wider, SI."""
    problem = models[0][1].problem
    record, measurements = problem.records[k], problem.measurements
    unit, shown = parse_unit(measurements.units[c]), symbol(measurements.units[c])
    value = np.where(problem.ok[k][rows, c], (record.values[rows, c] - unit.offset) / unit.factor, np.nan)
    band = 2.0 * problem.sigma[k][rows, c] / unit.factor
    if extra is not None:
        band = np.hypot(band, extra / unit.factor)
    traces = [Trace("measured", times, value, colour=7, unit=shown, in_legend=named)]
    for number, (called, fit) in enumerate(models):
        prediction = (fit.outputs[k][rows, c] - unit.offset) / unit.factor
        name = called if len(models) > 1 else "model"
        traces.append(Trace(name, times, prediction, colour=number, unit=shown, in_legend=named))
        if number == 0:
            noise = "model ± twice the noise" + (" and its curve's band" if extra is not None else "")
            traces.append(Trace(noise, times, prediction + band, unit=shown, faint=True, in_legend=named))
            traces.append(Trace("", times, prediction - band, unit=shown, faint=True, in_legend=False))
    return Panel(f"{plain_name(measurements.outputs[c])} [{shown}]", tuple(traces), height=1.2)


def _spans(times: Floats, phase: NDArray[np.intp]) -> tuple[Span, ...]:
    """Shaded spans, one for every second phase."""
    spans = []
    for number in np.unique(phase):
        inside = times[phase == number]
        if number % 2:
            spans.append(Span(float(inside[0]), float(inside[-1])))
    return tuple(spans)
