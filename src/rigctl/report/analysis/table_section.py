"""The page's part on a table of single values: each beside the model's, over the operating variable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.localise import variable_units
from rigctl.compare.result import Comparison, ModelComparison
from rigctl.compare.table_rows import TableRow, short_condition, shows_unfitted
from rigctl.model.measured.table import curve_variable, curves, set_variable
from rigctl.report.numbers import prose, symbol
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.section import plot_slot, render
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: the band of the noise, in standard deviations
_BAND = 2.0


@dataclass(frozen=True)
class TablePart:
    """What the page shows of one quantity: a plot, and its rows as text."""

    quantity: str
    plot: Plot
    slot: object
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def table_parts(comparison: Comparison) -> list[TablePart]:
    """Of every quantity of a table; none for measurements with a course in time."""
    first = comparison.models[0]
    found = []
    for number, quantity in enumerate(dict.fromkeys(row.quantity for row in first.rows)):
        plot = table_plot(comparison.models, quantity, f"table-{number}")
        head, rows = _text(comparison.models, quantity)
        found.append(TablePart(plain_name(quantity), plot, plot_slot(plot), head, rows))
    return found


def table_plot(models: Sequence[ModelComparison], quantity: str, key: str) -> Plot:
    """Measured values with what every model says, and below it what is left between them."""
    first = models[0]
    own = _rows(first, quantity)
    x, series, labels, x_title = _over(first)
    unit, relative = symbol(own[0].unit), _relative(first, own)
    upper: list[Trace] = []
    lower: list[Trace] = []
    for number, label in enumerate(labels):
        chosen = sorted((row for row in own if series[row.place] == number), key=lambda row: x[row.place])
        if not chosen:
            continue
        at = np.array([x[row.place] for row in chosen])
        before = f"{label} " if label else ""
        measured = np.array([row.measured for row in chosen])
        upper.append(Trace(f"{before}measured", at, measured, Look.POINTS, _hue(number, label), unit))
        upper += _laws(models, quantity, chosen, at, before, _hue(number, label), unit)
        lower += _residuals(models, quantity, chosen, at, before, _hue(number, label), relative)
    noise = np.array([row.noise / (row.measured / 100.0 if relative else 1.0) for row in own])
    ends = np.array([float(np.nanmin(x)), float(np.nanmax(x))])
    left = "%" if relative else unit
    for sign, name in ((1.0, f"± {_BAND:g} sigma of the noise"), (-1.0, "")):
        level = np.full(2, sign * _BAND * float(np.median(noise)))
        lower.append(Trace(name, ends, level, Look.LINE, 7, left, True, sign > 0.0))
    title = plain_name(quantity)
    panels = (
        Panel(f"{title} [{unit}]", tuple(upper), height=1.9),
        Panel(f"model − measured [{left}]", tuple(lower), height=1.5),
    )
    return Plot(key, f"{title} over {x_title}: marks measured, lines the model", x_title, panels)


def _rows(model: ModelComparison, quantity: str) -> list[TableRow]:
    return [row for row in model.rows if row.quantity == quantity]


def _relative(model: ModelComparison, rows: Sequence[TableRow]) -> bool:
    """Whether errors are shown as shares: where the noise is one."""
    return any(channel.share for channel in model.fit.problem.noise.channels) and all(
        row.measured for row in rows
    )


def _over(model: ModelComparison) -> tuple[Floats, NDArray[np.intp], list[str], str]:
    """(rows) x as it is shown, the number of each row's curve, the curves' names, and the title of x."""
    measurements = model.fit.problem.measurements
    setting = set_variable(measurements)
    points, series = curves(measurements, but=setting)
    name = curve_variable(measurements, but=setting) or curve_variable(measurements)
    if name is None:
        return points, series, [""] * (int(series.max(initial=0)) + 1), "row"
    units = variable_units(measurements)
    unit = parse_unit(units[name])
    x = np.array([unit.from_si(record.condition.get(name, np.nan)) for record in measurements.records])
    labels = []
    for number in range(int(series.max(initial=0)) + 1):
        record = measurements.records[int(np.flatnonzero(series == number)[0])]
        others = {key: value for key, value in record.condition.items() if key != name}
        labels.append(prose(short_condition(others, units)))
    return x, series, labels, f"{plain_name(name)} [{symbol(units[name])}]"


def _hue(number: int, label: str) -> int:
    """Curves have a colour each; a single one is grey, so that the models' colours are seen."""
    return number if label else 7


def _laws(
    models: Sequence[ModelComparison],
    quantity: str,
    chosen: Sequence[TableRow],
    at: Floats,
    before: str,
    hue: int,
    unit: str,
) -> list[Trace]:
    """The models' lines; of a single curve also other people's values."""
    places = [row.place for row in chosen]
    found = []
    for number, model in enumerate(models):
        by_place = {row.place: row for row in _rows(model, quantity)}
        said = np.array([by_place[place].predicted for place in places])
        name = f"{before}{model.name if len(models) > 1 else 'model'}"
        found.append(
            Trace(name, at, said, Look.LINE, hue if before else number, unit, model is not models[-1])
        )
    if not before:
        for number, name in enumerate(dict.fromkeys(name for row in chosen for name in row.beside)):
            values = np.array([row.beside.get(name, np.nan) for row in chosen])
            found.append(Trace(plain_name(name), at, values, Look.LINE, number + 3, unit, True))
    return found


def _residuals(
    models: Sequence[ModelComparison],
    quantity: str,
    chosen: Sequence[TableRow],
    at: Floats,
    before: str,
    hue: int,
    relative: bool,
) -> list[Trace]:
    """Model less measurement, of the fitted models, and of the first as its file has it."""
    unit = "%" if relative else symbol(chosen[0].unit)
    places = [row.place for row in chosen]

    def error(row: TableRow, value: float) -> float:
        return 100.0 * row.share(value) if relative else value - row.measured

    found = []
    for number, model in enumerate(models):
        by_place = {row.place: row for row in _rows(model, quantity)}
        values = np.array([error(by_place[place], by_place[place].predicted) for place in places])
        name = f"{before}{model.name if len(models) > 1 else 'model'} − measured"
        colour = hue if before else number
        found.append(Trace(name, at, values, Look.MARKED, colour, unit, in_legend=not before))
    if not before and len(models) == 1 and shows_unfitted(chosen):
        values = np.array([error(row, row.unfitted or 0.0) for row in chosen])
        found.append(Trace("the same with the constants of its file", at, values, Look.MARKED, 1, unit, True))
    return found


def _text(
    models: Sequence[ModelComparison], quantity: str
) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """The rows of the table as text, one column for each thing that is said of a value."""
    own = _rows(models[0], quantity)
    beside = list(dict.fromkeys(name for row in own for name in row.beside))
    fitted = shows_unfitted(own)
    head = ["at", f"measured [{symbol(own[0].unit)}]", "noise"]
    for model in models:
        name = model.name if len(models) > 1 else "model, fitted" if own[0].unfitted is not None else "model"
        head += [name, "model − measured", "in sigma"]
    head += ["as in its file", "in sigma"] if fitted and len(models) == 1 else []
    head += [plain_name(name.removeprefix(f"{quantity}_")) for name in beside]
    by_model = [{row.place: row for row in _rows(model, quantity)} for model in models]
    rows = []
    for row in own:
        cells = [prose(row.condition) + ("" if row.fitted else ", held out")]
        cells += [f"{row.measured:.5g}", f"{row.noise:.2g}"]
        for found in by_model:
            one = found[row.place]
            cells += [f"{one.predicted:.5g}", f"{100 * one.share(one.predicted):+.2f} %", f"{one.z:+.1f}"]
        if fitted and len(models) == 1:
            cells += [f"{row.unfitted or float('nan'):.5g}", f"{row.z_unfitted or 0.0:+.1f}"]
        cells += [f"{row.beside[name]:.5g}" if name in row.beside else "–" for name in beside]
        rows.append(tuple(cells))
    return tuple(head), tuple(rows)


def table_body(parts: Sequence[TablePart], findings: Sequence[str]) -> object:
    """The pictures, what they say, and the rows, as HTML."""
    return render("table.html", parts=parts, findings=findings)
