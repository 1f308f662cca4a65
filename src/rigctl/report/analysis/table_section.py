"""The section on a table of single values: measured and modelled, over the operating variable.

In: a comparison of models with the rows of a table. Out: one `Plot` for each quantity, values above and
residuals below. Rows that differ only in one variable are joined by a line over it; each combination of
the others is a curve of its own, with its own colour.

Residuals are in per cent where the noise is relative to the value, so that one band stands for the noise
of all rows. For a single model the values with the constants of its file are drawn too, so that one sees
what the fit has changed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison_result import Comparison, ModelComparison
from rigctl.analysis.single_values.rows import TableRow, short_condition, shows_unfitted
from rigctl.answers.numbers import prose, symbol
from rigctl.model.measured.conditions import variable_units
from rigctl.model.measured.table import curve_variable, curves, set_variable
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: the band of the noise, in standard deviations
_BAND = 2.0


@dataclass(frozen=True)
class _Curve:
    """Rows that are joined by a line, in the order of x; `label` states their common conditions, "" for a
    single curve."""

    label: str
    number: int
    rows: tuple[TableRow, ...]
    at: Floats

    @property
    def prefix(self) -> str:
        """The prefix of the names of its traces."""
        return f"{self.label} " if self.label else ""

    @property
    def hue(self) -> int:
        """Each curve has its colour; a single one is grey, so that the models' colours are visible."""
        return self.number if self.label else 7


def table_plots(comparison: Comparison) -> list[Plot]:
    """The views of all quantities of a table; none for time series."""
    quantities = dict.fromkeys(row.quantity for row in comparison.models[0].rows)
    return [table_plot(comparison.models, name, f"table-{k}") for k, name in enumerate(quantities)]


def table_plot(models: Sequence[ModelComparison], quantity: str, key: str) -> Plot:
    """Measured values and the predictions of every model, with the residuals below."""
    rows = _rows(models[0], quantity)
    x, drawn, x_title = _curves(models[0], rows)
    unit, relative = symbol(rows[0].unit), _relative(models[0], rows)
    residual_unit = "%" if relative else unit
    upper: list[Trace] = []
    lower: list[Trace] = []
    for curve in drawn:
        measured = np.array([row.measured for row in curve.rows])
        upper.append(Trace(f"{curve.prefix}measured", curve.at, measured, Look.POINTS, curve.hue, unit))
        upper += [*_laws(models, curve, unit), *_others(curve, unit)]
        lower += _residuals(models, curve, residual_unit, relative=relative)
    lower += _noise_band(rows, x, residual_unit, relative=relative)
    title = plain_name(quantity)
    panels = (
        Panel(f"{title} [{unit}]", tuple(upper), height=1.9),
        Panel(f"model − measured [{residual_unit}]", tuple(lower), height=1.5),
    )
    return Plot(key, f"{title} over {x_title}: measured (markers) and model (lines)", x_title, panels)


def _rows(model: ModelComparison, quantity: str) -> list[TableRow]:
    return [row for row in model.rows if row.quantity == quantity]


def _relative(model: ModelComparison, rows: Sequence[TableRow]) -> bool:
    """Whether errors are shown as shares: if the noise is relative."""
    return any(channel.share for channel in model.fit.problem.noise.channels) and all(
        row.measured for row in rows
    )


def _curves(model: ModelComparison, rows: Sequence[TableRow]) -> tuple[Floats, list[_Curve], str]:
    """(records) x as it is shown, the rows by curve, and the title of x."""
    measurements = model.fit.problem.measurements
    setting = set_variable(measurements)
    x, series = curves(measurements, but=setting)
    name = curve_variable(measurements, but=setting) or curve_variable(measurements)
    units = variable_units(measurements)
    x_title = "row"
    if name is not None:
        unit = parse_unit(units[name])
        x = np.array([unit.from_si(record.condition.get(name, np.nan)) for record in measurements.records])
        x_title = f"{plain_name(name)} [{symbol(units[name])}]"
    result = []
    for number in np.unique(series):
        joined = sorted((row for row in rows if series[row.record] == number), key=lambda row: x[row.record])
        if not joined:
            continue
        condition = measurements.records[int(np.flatnonzero(series == number)[0])].condition
        others = {key: value for key, value in condition.items() if key != name}
        label = "" if name is None else prose(short_condition(others, units))
        at = np.array([x[row.record] for row in joined])
        result.append(_Curve(label, int(number), tuple(joined), at))
    return x, result, x_title


def _of_models(
    models: Sequence[ModelComparison],
    curve: _Curve,
    shown: Callable[[TableRow], float],
    look: Look,
    unit: str,
    what: str = "",
) -> list[Trace]:
    """For each model one line through `shown` of its rows; all but the last are faint."""
    traces = []
    for number, model in enumerate(models):
        by_record = {row.record: row for row in _rows(model, curve.rows[0].quantity)}
        values = np.array([shown(by_record[row.record]) for row in curve.rows])
        name = f"{curve.prefix}{model.name if len(models) > 1 else 'model'}{what}"
        colour, faint = curve.hue if curve.label else number, model is not models[-1]
        # for several curves the legend of the traces above identifies the colours
        named = not (what and curve.label)
        traces.append(Trace(name, curve.at, values, look, colour, unit, faint, named))
    return traces


def _laws(models: Sequence[ModelComparison], curve: _Curve, unit: str) -> list[Trace]:
    """The predictions of the models."""
    return _of_models(models, curve, lambda row: row.predicted, Look.LINE, unit)


def _others(curve: _Curve, unit: str) -> list[Trace]:
    """Published values of others beside a single curve."""
    if curve.label:
        return []
    names = dict.fromkeys(name for row in curve.rows for name in row.beside)
    return [
        Trace(
            plain_name(name),
            curve.at,
            np.array([row.beside.get(name, np.nan) for row in curve.rows]),
            Look.LINE,
            number + 3,
            unit,
            faint=True,
        )
        for number, name in enumerate(names)
    ]


def _residuals(models: Sequence[ModelComparison], curve: _Curve, unit: str, *, relative: bool) -> list[Trace]:
    """Model less measurement, for the fitted models, and for a single one also with the values of its
    file."""

    def error(row: TableRow, value: float | None) -> float:
        if value is None:
            return np.nan
        return 100.0 * row.share(value) if relative else value - row.measured

    traces = _of_models(
        models, curve, lambda row: error(row, row.predicted), Look.MARKED, unit, " − measured"
    )
    if not curve.label and len(models) == 1 and shows_unfitted(curve.rows):
        values = np.array([error(row, row.unfitted) for row in curve.rows])
        name = "model with the constants of its file"
        traces.append(Trace(name, curve.at, values, Look.MARKED, 1, unit, faint=True))
    return traces


def _noise_band(rows: Sequence[TableRow], x: Floats, unit: str, *, relative: bool) -> list[Trace]:
    """The noise band over the whole range of x: the median noise of all rows."""
    sizes = [row.noise / (row.measured / 100.0 if relative else 1.0) for row in rows]
    level = np.full(2, _BAND * float(np.median(sizes)))
    ends = np.array([float(np.nanmin(x)), float(np.nanmax(x))])
    name = f"± {_BAND:g} times the noise"
    return [
        Trace(name, ends, level, Look.LINE, 7, unit, faint=True),
        Trace("", ends, -level, Look.LINE, 7, unit, faint=True, in_legend=False),
    ]
