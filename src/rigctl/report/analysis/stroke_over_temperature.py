"""Stroke against temperature: the usual plot of a hydraulic bench in publications."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.answers.numbers import plural, symbol
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.conditions import variable_units
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit, significant


def stroke_plot(models: Sequence[ModelComparison], key: str = "model-stroke") -> Plot | None:
    """Stroke against temperature by pressure, measured and of every model; None without strokes."""
    problem = models[0].fit.problem
    units = variable_units(problem.measurements)
    hot = next((name for name in problem.measurements.variables if parse_unit(units[name]).offset), None)
    if "position" not in problem.measurements.outputs or hot is None:
        return None
    column = problem.measurements.outputs.index("position")
    unit = problem.measurements.units[column]
    traces: list[Trace] = []
    for number, (label, indices) in enumerate(_groups(problem, hot, units)):
        points = [parse_unit(units[hot]).from_si(problem.records[k].condition[hot]) for k in indices]
        x, order = np.array(points), np.argsort(points)

        def line(model: ModelComparison, *, measured: bool, at: Sequence[int] = indices) -> np.ndarray:
            values = [_stroke(model, k, column, measured=measured) for k in at]
            return np.array(values) / parse_unit(unit).factor

        measured = line(models[0], measured=True)[order]
        traces.append(Trace(label, x[order], measured, Look.POINTS, number, symbol(unit)))
        for model in models:
            name, faint = model.name if len(models) > 1 else "model", model is not models[-1]
            prediction = line(model, measured=False)[order]
            # the legend names each model once; pressures are labelled at their marks
            traces.append(
                Trace(name, x[order], prediction, Look.LINE, number, symbol(unit), faint, not number)
            )
    x_title = f"{plain_name(hot)} [{symbol(units[hot])}]"
    caption = "Stroke against temperature: measured (markers) and model (lines)"
    panel = Panel(f"stroke [{symbol(unit)}]", tuple(traces), height=2.4)
    return Plot(key, caption, x_title, (panel,))


def held_out_strokes(before: ModelComparison, after: ModelComparison) -> str:
    """How far two models are off the strokes of records that no fit saw (root of the mean square); "" where
    there are none."""
    problem = before.fit.problem
    held_out = before.fit.held_out
    if "position" not in problem.measurements.outputs or not held_out:
        return ""
    column = problem.measurements.outputs.index("position")
    unit = parse_unit(problem.measurements.units[column])

    def error(model: ModelComparison) -> str:
        misses = [
            _stroke(model, k, column, measured=False) - _stroke(model, k, column, measured=True)
            for k in held_out
        ]
        return f"{significant(float(np.sqrt(np.nanmean(np.square(misses)))) / unit.factor, 2)} {unit.text}"

    records = plural(len(held_out), "record")
    return f"error of the stroke on {records} that no fit saw: {error(before)} before, {error(after)} after"


def _groups(problem: Problem, hot: str, units: dict[str, str]) -> list[tuple[str, list[int]]]:
    """Records that differ only in temperature, by their common conditions."""
    rest = [name for name in problem.measurements.variables if name != hot]
    groups: dict[tuple[float, ...], list[int]] = {}
    for k, record in enumerate(problem.records):
        key = tuple(float(f"{record.condition.get(name, np.nan):.5g}") for name in rest)
        groups.setdefault(key, []).append(k)
    return [
        (
            ", ".join(
                f"{significant(parse_unit(units[name]).from_si(value))} {symbol(units[name])}"
                for name, value in zip(rest, key, strict=True)
            ),
            indices,
        )
        for key, indices in sorted(groups.items())
    ]


def _stroke(model: ModelComparison, k: int, column: int, *, measured: bool) -> float:
    """Position while the valve is closed after the extension, less that at the start."""
    record, ok = model.fit.problem.records[k], model.fit.problem.ok[k][:, column]
    values = record.values[:, column] if measured else model.fit.expected_outputs[k][:, column]
    hold = record.phases.index("hold") if "hold" in record.phases else len(record.phases) - 1
    after, before = (record.phase == hold) & ok, (record.phase == 0) & ok
    if not after.any():
        return float("nan")
    base = float(values[before].mean()) if hold and before.any() else 0.0
    return float(values[after].mean()) - base
