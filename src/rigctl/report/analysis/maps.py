"""Error maps: every condition, in sigmas of the noise, for a channel or a phase."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.localisation import variable_units, whitened_errors
from rigctl.report.heat_map import HeatMap
from rigctl.report.numbers import symbol
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

_LIMIT = 4.0


def channel_maps(
    model: ModelComparison, key: str, limit: float | None = None, *, title: str = ""
) -> tuple[HeatMap, ...]:
    """Of each channel, the signed RMS error of each condition: the first variable down, the second across.

    `title` says which of several this is.
    """
    problem = model.fit.problem
    variables = problem.measurements.variables[:2]
    if not variables:
        return ()
    units = variable_units(problem.measurements)
    points = [tuple(record.condition.get(name, math.nan) for name in variables) for record in problem.records]
    if len(variables) == 1:
        points = [(one[0], 0.0) for one in points]
    rows = sorted({_rounded(point[0]) for point in points})
    columns = sorted({_rounded(point[1]) for point in points})
    places = range(len(points))
    plain = [model.fit.normalised_error(k) for k in places]
    white = [whitened_errors(model.fit, k) for k in places]
    found = []
    for c, channel in enumerate(problem.measurements.outputs):
        errors, whitened = (
            _pooled([one[:, c] for one in every], points, rows, columns) for every in (plain, white)
        )
        values = tuple(tuple(map(_signed_rms, row)) for row in errors)
        strong = tuple(tuple(map(_stands_out, row)) for row in whitened)
        found.append(
            HeatMap(
                id=f"{key}-{channel}",
                caption=f"{title}{plain_name(channel)}: error in sigmas of the noise, 1 is noise alone; "
                "its sign is that of model − measured; * more than chance",
                row_title=_title(variables[0], units),
                column_title=_title(variables[1], units) if len(variables) > 1 else "",
                rows=tuple(_shown(value, variables[0], units) for value in rows),
                columns=tuple(_shown(value, variables[1], units) for value in columns)
                if len(variables) > 1
                else ("error",),
                values=values,
                strong=strong,
                limit=limit or _LIMIT,
            )
        )
    return tuple(found)


def _pooled(
    errors: Sequence[Floats],
    points: Sequence[tuple[float, ...]],
    rows: Sequence[float],
    columns: Sequence[float],
) -> list[list[Floats]]:
    """The errors of all records of each condition together."""
    cells: dict[tuple[float, float], list[Floats]] = {}
    for error, point in zip(errors, points, strict=True):
        cells.setdefault((_rounded(point[0]), _rounded(point[1])), []).append(error[np.isfinite(error)])
    return [[np.concatenate(cells.get((r, col), [np.empty(0)])) for col in columns] for r in rows]


def _signed_rms(errors: Floats) -> float:
    """Root mean square over all records of a condition, with the sign of their mean; NaN without any."""
    return float(np.sqrt(np.mean(errors**2)) * np.sign(errors.mean())) if errors.size else math.nan


def _stands_out(errors: Floats) -> bool:
    """Whether whitened errors do, by more than four standard deviations of what noise alone makes."""
    return bool(errors.size) and abs(_signed_rms(errors)) > 1.0 + 4.0 / math.sqrt(2.0 * errors.size)


def _rounded(value: float) -> float:
    return float(f"{value:.5g}")


def _title(name: str, units: dict[str, str]) -> str:
    unit = symbol(units.get(name, "1"))
    return f"{plain_name(name)} [{unit}]" if unit else plain_name(name)


def _shown(value: float, name: str, units: dict[str, str]) -> str:
    return f"{parse_unit(units.get(name, '1')).from_si(value):.4g}"
