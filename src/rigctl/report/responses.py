"""Results over the operating points of a campaign: stroke, and every measure, against what was swept.

In: the records of one or several runs. Out: one plot for each quantity, over the swept temperature or
else the variable with the most values, with one line for each combination of the others. A sweep of one
point gives no plot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

import numpy as np

from rigctl.answers.numbers import symbol
from rigctl.json_values import finite_or_none
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.run_data import RecordData, RunData
from rigctl.report.signals import plain_name, quantity_name, sweep_label
from rigctl.report.stroke import REST, find_motion, stroke
from rigctl.units import convert, parse_unit

STROKE_ORIGIN = (
    f"From the position: its mean {REST:g} to {2 * REST:g} s after the valve has closed, less its mean over "
    f"the {REST:g} s before it opens."
)


@dataclass(frozen=True)
class Point:
    """One operating point of a series: x, and one value per usable record (its replicates)."""

    x: float
    values: tuple[float, ...]

    @property
    def mean(self) -> float:
        """Mean of the replicates."""
        return fmean(self.values)

    @property
    def spread(self) -> float | None:
        """Standard deviation of the replicates; None for fewer than two."""
        return stdev(self.values) if len(self.values) > 1 else None


@dataclass(frozen=True)
class Series:
    """The points that have everything but x in common, e.g. one supply pressure."""

    label: str
    points: tuple[Point, ...]

    def at(self, x: float) -> Point | None:
        """The point at x, if it was measured."""
        return next((point for point in self.points if point.x == x), None)


@dataclass(frozen=True)
class Response:
    """One result over the swept variables; units are in the form that files use."""

    name: str
    unit: str
    x_name: str
    x_unit: str
    series: tuple[Series, ...]
    origin: str = ""  #: origin of the values, if the procedure does not name it

    @property
    def x_title(self) -> str:
        """The title of the x axis, as prose: ``oil temperature`` for a temperature swept as ``oil``."""
        name = plain_name(self.x_name)
        kind = quantity_name(parse_unit(self.x_unit).dimension)
        return name if kind is None or kind in name else f"{name} {kind}"

    @property
    def xs(self) -> tuple[float, ...]:
        """All values of x, rising."""
        return tuple(sorted({point.x for one in self.series for point in one.points}))

    def largest_change(self) -> tuple[Series, Point, Point] | None:
        """The series, its first point, and the point whose mean differs most from the first one's."""
        candidates = [
            (one, one.points[0], max(one.points, key=lambda point: abs(point.mean - one.points[0].mean)))
            for one in self.series
            if len(one.points) > 1
        ]
        return max(candidates, key=lambda item: abs(item[2].mean - item[1].mean), default=None)


def responses(runs: Sequence[RunData]) -> list[Response]:
    """The results from the usable records of the runs; the stroke comes first.

    x is the swept temperature, or else the variable with the most steps; the other variables, and the runs,
    distinguish the series. Runs without a sweep give no result.
    """
    all_responses: list[Response] = []
    names = list(dict.fromkeys(record.name for run in runs for record in run.records))
    for name in names:
        pairs = [(run, record) for run in runs for record in run.records if record.name == name]
        usable = [pair for pair in pairs if pair[1].usable and pair[1].sweep]
        x_name = _choose_x([record for _, record in usable])
        if x_name is None:
            continue
        for quantity in _quantities(usable):
            plain = len(names) == 1 or quantity.name == name
            label = quantity.name if plain else f"{quantity.name} of {name}"
            response = _response(label, quantity, x_name, usable, by_run=len(runs) > 1)
            if response is not None:
                all_responses.append(response)
    return all_responses


def response_plot(response: Response, key: str) -> Plot:
    """A line through the means of every series, and a mark for each record."""
    traces: list[Trace] = []
    for number, one in enumerate(response.series):
        xs = np.array([point.x for point in one.points])
        means = np.array([point.mean for point in one.points])
        unit = symbol(response.unit)
        traces.append(Trace(one.label, xs, means, Look.MARKED, number, unit))
        repeated = [
            (point.x, value) for point in one.points if len(point.values) > 1 for value in point.values
        ]
        if repeated:
            x, y = np.array(repeated).T
            traces.append(Trace(f"{one.label}, single", x, y, Look.POINTS, number, unit, in_legend=False))
    title = (
        f"{plain_name(response.name)} [{symbol(response.unit)}]" if symbol(response.unit) else response.name
    )
    x_title = f"{response.x_title} [{symbol(response.x_unit) or '1'}]"
    caption = f"{plain_name(response.name)} against {response.x_title}"
    return Plot(key, caption, x_title, (Panel(title, tuple(traces), height=2.3),))


def _choose_x(records: Sequence[RecordData]) -> str | None:
    """The variable on the x axis; None if nothing was swept in at least two steps."""
    values: dict[str, set[float]] = {}
    units: dict[str, str] = {}
    for record in records:
        for name, (value, unit) in record.sweep.items():
            values.setdefault(name, set()).add(value)
            units[name] = unit
    swept = [name for name, steps in values.items() if len(steps) > 1]
    temperature = parse_unit("K").dimension
    hot = [name for name in swept if parse_unit(units[name]).dimension == temperature]
    return hot[0] if hot else max(swept, key=lambda name: len(values[name]), default=None)


_Value = Callable[[RunData, RecordData], float | None]


@dataclass(frozen=True)
class _Quantity:
    """Something that every record may have a value of, in `unit`; `origin` as in `Response`."""

    name: str
    unit: str
    value: _Value
    origin: str = ""


def _quantities(pairs: Sequence[tuple[RunData, RecordData]]) -> list[_Quantity]:
    """What can be shown for these records; the stroke comes first."""
    quantities: dict[str, _Quantity] = {}
    motions = {run.id: find_motion(run) for run, _ in pairs}
    known = [motion for motion in motions.values() if motion is not None]
    if known:

        def stroke_of(run: RunData, record: RecordData) -> float | None:
            motion = motions[run.id]
            return None if motion is None else stroke(run, record, motion)

        measured = any(one.name == "stroke" for _, record in pairs for one in record.measures)
        origin = "" if measured else STROKE_ORIGIN
        quantities["stroke"] = _Quantity("stroke", known[0].position.unit, stroke_of, origin)
    for _, record in pairs:
        for one in record.measures:
            if one.name not in quantities:
                quantities[one.name] = _Quantity(one.name, one.unit, _measure_named(one.name, one.unit))
    return list(quantities.values())


def _measure_named(name: str, unit: str) -> _Value:
    def value(_: RunData, record: RecordData) -> float | None:
        matches = [measured for measured in record.measures if measured.name == name]
        return _same_unit(matches[-1].value, matches[-1].unit, unit) if matches else None

    return value


def _same_unit(value: float, unit: str, wanted: str) -> float | None:
    """The value in the unit of the others; None if it has another dimension."""
    if unit != wanted:
        if parse_unit(unit).dimension != parse_unit(wanted).dimension:
            return None
        value = convert(value, unit, wanted)
    return finite_or_none(value)


def _response(
    name: str,
    quantity: _Quantity,
    x_name: str,
    pairs: Sequence[tuple[RunData, RecordData]],
    *,
    by_run: bool,
) -> Response | None:
    cells: dict[tuple[str, tuple[float, ...]], dict[float, list[float]]] = {}
    x_unit = ""
    for run, record in pairs:
        result = quantity.value(run, record)
        if result is None or x_name not in record.sweep:
            continue
        swept, swept_unit = record.sweep[x_name]
        x_unit = x_unit or swept_unit
        x = _same_unit(swept, swept_unit, x_unit)
        if x is None:
            continue
        others = {key: item for key, item in record.sweep.items() if key != x_name}
        label = " · ".join(part for part in (run.id if by_run else "", sweep_label(others)) if part)
        order = tuple(item[0] for item in others.values())
        cells.setdefault((label or plain_name(name), order), {}).setdefault(x, []).append(result)
    if not cells:
        return None
    series = tuple(
        Series(label, tuple(Point(x, tuple(values)) for x, values in sorted(points.items())))
        for (label, order), points in sorted(cells.items(), key=lambda item: (item[0][1], item[0][0]))
    )
    return Response(name, quantity.unit, x_name, x_unit, series, quantity.origin)
