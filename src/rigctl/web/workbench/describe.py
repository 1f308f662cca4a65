"""The description of an open workbench for its page.

In: a `Workbench`. Out: two kinds of message. What stays the same while sliders move (channels, records,
conditions, commands) is sent once as JSON; what follows a slider, the curves of the records in view and
the errors of all, is sent in frames of 32-bit floats.

Of a long record as many samples are drawn as a plot has pixels, with the extremes of every channel among
them; they are chosen from the measurement, and the model is drawn at the same. The rows of a table are
records of one moment each, and are put together to curves here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.frequency_response import moving_inputs
from rigctl.answers.numbers import symbol
from rigctl.model.fit.problem import Problem
from rigctl.model.history.store import current_version
from rigctl.model.measured.conditions import condition_text, variable_units
from rigctl.model.measured.table import curve_variable, curves
from rigctl.report.decimation import thin
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit, significant
from rigctl.web.workbench.frames import frame
from rigctl.workbench import Picture, State, Workbench

Floats = NDArray[np.float64]

#: points of a curve: enough for a plot of some thousand pixels
_POINTS = 2000


def opened_document(bench: Workbench) -> dict[str, Any]:
    """Everything that stays the same while sliders move."""
    problem, subject = bench.problem, bench.opened.subject
    measured = problem.measurements
    version = current_version(bench.model.path) if bench.model.path is not None else None
    held_out = set(bench.opened.data.held_out)
    return {
        "kind": "opened",
        "runs": list(subject.runs),
        "model": subject.model,
        "name": bench.model.name,
        "title": bench.model.family.title,
        "version": None if version is None else version.number,
        "channels": [
            {
                "name": name,
                "title": plain_name(measured.titles.get(name, name)),
                "unit": symbol(_difference_unit(unit)),
                "shown": symbol(unit),
            }
            for name, unit in zip(measured.outputs, measured.units, strict=True)
        ],
        "inputs": [] if measured.table else _moving(problem),
        "sliders": [one.document() for one in bench.sliders],
        "switches": [{**one.document(), "title": plain_name(one.name)} for one in bench.switches],
        "records": _records(problem, held_out),
        "map": _axes(problem),
        "over": _over(problem),
        "notes": [*map(str, measured.notes), problem.noise.statement],
        "state": state_document(bench.track.present),
        "commands": {verb: subject.analysis(verb) for verb in ("compare", "diagnose", "design", "discover")}
        | {"fit": subject.change("fit"), "history": subject.history()},
    }


def state_document(state: State) -> dict[str, Any]:
    """A state in the form of the page."""
    return {"values": dict(state.values), "on": sorted(state.on)}


def _moving(problem: Problem) -> list[dict[str, str]]:
    """The inputs that move in any record."""
    names = moving_inputs(problem, range(len(problem.records)))
    return [{"name": name, "title": plain_name(name)} for name in names]


def _difference_unit(unit: str) -> str:
    return "K" if parse_unit(unit).offset else unit


def _records(problem: Problem, held_out: set[int]) -> list[dict[str, Any]]:
    units = variable_units(problem.measurements)
    return [
        {
            "label": record.label,
            "condition": condition_text(record.condition, units).replace("_", " "),
            "held_out": k in held_out,
            "series": _series_text(problem, k),
            "phases": [{"name": name, "from": start} for name, start in _phases(problem, k)],
        }
        for k, record in enumerate(problem.records)
    ]


def _phases(problem: Problem, k: int) -> list[tuple[str, float]]:
    """The phases of a record with their start times."""
    record = problem.records[k]
    starts = np.flatnonzero(np.diff(record.phase, prepend=-1))
    return [(record.phases[record.phase[at]], float(record.times[at])) for at in starts]


def _axes(problem: Problem) -> dict[str, Any]:
    """The position of each record on the error map: the first variable down, the second across."""
    measured = problem.measurements
    units, names = variable_units(measured), measured.variables[:2]
    axes = []
    for name in names:
        values = sorted({_rounded(record.condition.get(name, math.nan)) for record in problem.records})
        shown = [significant(parse_unit(units[name]).from_si(value)) for value in values]
        axes.append(
            {"title": plain_name(name), "unit": symbol(units[name]), "values": values, "shown": shown}
        )
    cells = [
        [
            axis["values"].index(_rounded(record.condition.get(name, math.nan)))
            for axis, name in zip(axes, names, strict=True)
        ]
        for record in problem.records
    ]
    return {
        "axes": [{key: axis[key] for key in ("title", "unit", "shown")} for axis in axes],
        "cells": cells,
    }


def _rounded(value: float) -> float:
    return float(f"{value:.5g}") if math.isfinite(value) else 0.0


def _over(problem: Problem) -> dict[str, str] | None:
    """The variable over which the rows of a table are drawn; None for time series."""
    measured = problem.measurements
    if not measured.table:
        return None
    name = curve_variable(measured)
    if name is None:
        return {"title": "row", "unit": ""}
    return {"title": plain_name(name), "unit": symbol(variable_units(measured)[name])}


def series_of(problem: Problem, k: int) -> tuple[int, ...]:
    """The records that are drawn as one with this one: itself, or the rows of a table on its curve."""
    measured = problem.measurements
    if not measured.table:
        return (k,)
    points, series = curves(measured)
    rows = np.flatnonzero(series == series[k])
    return tuple(int(row) for row in rows[np.argsort(points[rows], kind="stable")])


def _series_text(problem: Problem, k: int) -> str:
    """The common conditions of the rows on the curve of a row, as text."""
    measured = problem.measurements
    if not measured.table:
        return ""
    over, condition = curve_variable(measured), measured.records[k].condition
    common = {name: value for name, value in condition.items() if name != over}
    return condition_text(common, variable_units(measured)).replace("_", " ") if common else ""


def shown_samples(problem: Problem, k: int) -> NDArray[np.intp]:
    """The samples of a record that are drawn; extremes of every channel are among them."""
    record = problem.records[k]
    columns = record.values.shape[1]
    if record.times.size <= _POINTS:
        return np.arange(record.times.size)
    each = max(200, _POINTS // columns)
    return np.unique(np.concatenate([thin(record.values[:, c], each) for c in range(columns)]))


def _drawn(problem: Problem, k: int, of: Callable[[int], Floats]) -> Floats:
    """(points, channels) values of `of` at each sample of a record; of a row, its reading on its curve."""
    if not problem.measurements.table:
        return of(k)[shown_samples(problem, k)]
    return np.array([_reading(problem, row, of(row)) for row in series_of(problem, k)])


def _reading(problem: Problem, row: int, values: Floats) -> Floats:
    """(channels) the value that belongs to each channel's reading, which is its last sample."""
    present = problem.records[row].here
    last = [int(np.flatnonzero(one)[-1]) if one.any() else -1 for one in present.T]
    return values[last, np.arange(len(last))]


def _positions(problem: Problem, k: int) -> Floats:
    """(points) times, s; for rows of a table the variable of the x axis, in its unit."""
    measured = problem.measurements
    if not measured.table:
        return problem.records[k].times[shown_samples(problem, k)]
    rows, name = list(series_of(problem, k)), curve_variable(measured)
    if name is None:
        return np.array(rows, dtype=float) + 1.0
    unit = parse_unit(variable_units(measured)[name])
    return np.array([unit.from_si(point) for point in curves(measured)[0][rows]])


def record_frame(bench: Workbench, k: int) -> bytes:
    """The measurements of a record: times, readings, their noise and which of them count."""
    problem = bench.problem
    units = problem.measurements.units
    records, sigma, counts = problem.records, problem.sigma, problem.ok
    return frame(
        {"kind": "record", "record": k},
        [
            ("times", _positions(problem, k)),
            ("measured", _in_units(_drawn(problem, k, lambda at: records[at].values), units).T),
            ("sigma", (_drawn(problem, k, lambda at: sigma[at]) / _factors(units)).T),
            ("counts", _drawn(problem, k, lambda at: counts[at].astype(float)).T),
        ],
    )


def picture_frame(
    bench: Workbench, picture: Picture, shown: Sequence[int], header: Mapping[str, Any]
) -> bytes:
    """A picture: the errors of every record, and the curves of those shown."""
    problem = bench.problem
    units = problem.measurements.units
    named = dict(zip(problem.measurements.outputs, units, strict=True))
    arrays: list[tuple[str, Floats]] = [("size", picture.size), ("bias", picture.bias)]
    drawn = [k for k in dict.fromkeys(shown) if set(series_of(problem, k)) <= set(picture.outputs)]
    for k in drawn:
        modelled = _drawn(problem, k, picture.outputs.__getitem__)
        arrays.append((f"model {k}", _in_units(modelled, units).T))
        arrays.append((f"error {k}", _drawn(problem, k, picture.errors.__getitem__).T))
    document = {"kind": "picture", **header, **picture.document(named), "shown": drawn}
    return frame(_finite(document), arrays)


def _in_units(values: Floats, units: Sequence[str]) -> Floats:
    offsets = np.array([parse_unit(unit).offset for unit in units])
    return np.asarray((values - offsets) / _factors(units))


def _factors(units: Sequence[str]) -> Floats:
    return np.array([parse_unit(unit).factor for unit in units])


def _finite(value: Any) -> Any:
    """JSON has no NaN: null stands for it."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
