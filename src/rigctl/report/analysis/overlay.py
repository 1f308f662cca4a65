"""Measured and model over each other with the noise band, and what is left between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.fit import FitResult
from rigctl.report.numbers import symbol
from rigctl.report.plot import Look, Panel, Plot, Span, Trace
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

_MOST_POINTS = 1500
#: colours of residuals are others than those of two models
_AFTER_MODELS = 2


def normalised_error(fit: FitResult, k: int) -> Floats:
    """(n, channels) model less measurement over the noise of the record at place k; NaN where none counts."""
    record, ok = fit.problem.records[k], fit.problem.ok[k]
    return np.where(ok, (fit.outputs[k] - record.values) / fit.problem.sigma[k], np.nan)


def typical_records(fit: FitResult) -> tuple[tuple[str, int], ...]:
    """(what it is, place) of the worst, the middle and the best record."""
    sizes = [float(np.sqrt(np.nanmean(normalised_error(fit, k) ** 2))) for k in range(len(fit.outputs))]
    order = sorted(range(len(sizes)), key=lambda k: -sizes[k])
    chosen = {order[0]: "the worst record"}
    if len(order) > 2:
        chosen.setdefault(order[len(order) // 2], "a middling record")
    if len(order) > 1:
        chosen.setdefault(order[-1], "the best record")
    return tuple((name, k) for k, name in chosen.items())


def overlay_plot(models: Sequence[tuple[str, FitResult]], k: int, key: str, caption: str) -> Plot:
    """One record: every channel with its noise band and the models, and the residuals in sigmas below.

    `models` are names and what each says of the same records; the residuals are the first one's.
    """
    first = models[0][1]
    record, measurements = first.problem.records[k], first.problem.measurements
    rows = np.unique(np.linspace(0, record.times.size - 1, min(record.times.size, _MOST_POINTS)).astype(int))
    times = record.times[rows]
    panels: list[Panel] = []
    for c, (name, unit_name) in enumerate(zip(measurements.outputs, measurements.units, strict=True)):
        unit = parse_unit(unit_name)
        shown = symbol(unit_name)
        ok = first.problem.ok[k][rows, c]
        if not ok.any():
            continue
        value = np.where(ok, (record.values[rows, c] - unit.offset) / unit.factor, np.nan)
        band = 2.0 * first.problem.noise.sigma[c] / unit.factor
        traces = [Trace("measured", times, value, Look.LINE, 7, shown, in_legend=not panels)]
        for number, (called, fit) in enumerate(models):
            said = (fit.outputs[k][rows, c] - unit.offset) / unit.factor
            name_of = called if len(models) > 1 else "model"
            traces.append(Trace(name_of, times, said, Look.LINE, number, shown, in_legend=not panels))
            if number == 0:
                traces.append(
                    Trace(
                        "model ± 2 sigma of the noise",
                        times,
                        said + band,
                        Look.LINE,
                        0,
                        shown,
                        True,
                        not panels,
                    )
                )
                traces.append(Trace("", times, said - band, Look.LINE, 0, shown, True, False))
        panels.append(Panel(f"{plain_name(name)} [{shown}]", tuple(traces), height=1.2))
    residuals = [
        Trace(
            plain_name(name),
            times,
            normalised_error(first, k)[rows, c],
            Look.LINE,
            c + _AFTER_MODELS,
            "sigma",
        )
        for c, name in enumerate(measurements.outputs)
        if first.problem.ok[k][:, c].any()
    ]
    panels.append(Panel("model − measured [sigma]", tuple(residuals), height=1.2))
    return Plot(key, caption, "time in the record [s]", tuple(panels), _spans(record.times, record.phase))


def _spans(times: Floats, phase: NDArray[np.intp]) -> tuple[Span, ...]:
    """Every second phase is shaded."""
    found = []
    for number in np.unique(phase):
        inside = times[phase == number]
        if number % 2:
            found.append(Span(float(inside[0]), float(inside[-1])))
    return tuple(found)
