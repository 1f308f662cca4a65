"""Error maps of a channel over all conditions, in sigmas of the noise: the signed bias, and the size.

In: a compared model whose records have operating variables. Out: two `HeatMap`s for each channel, the
first variable down and the second across; records of one condition are pooled.

Two maps, because one number cannot say both: an error that changes its sign within a record has a mean of
zero and may be large. The noise is subtracted from the size, which otherwise would be 1 where nothing is
wrong. Colours show the errors of readings in sigmas; marks, which say more than chance, are set by
whitened residuals, since neighbouring readings share some of their noise and count for fewer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.agreement.localisation import whitened_errors
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.answers.numbers import symbol
from rigctl.model.measured.conditions import variable_units
from rigctl.report.heat_map import HeatMap
from rigctl.report.signals import plain_name
from rigctl.units import parse_unit, significant

Floats = NDArray[np.float64]

Values = tuple[tuple[float, ...], ...]
Marks = tuple[tuple[bool, ...], ...]

#: sigmas of the strongest colour, for a size and for a bias
_LIMIT, _BIAS_LIMIT = 4.0, 2.0


def channel_maps(
    model: ModelComparison,
    key: str,
    *,
    title: str = "",
    channels: Sequence[str] | None = None,
) -> tuple[HeatMap, ...]:
    """Two maps of each channel, the first variable down, the second across; see `_maps_of`.

    Parameters
    ----------
    title: identifies one of several models.
    channels: to show; with None those with an error beyond the noise at any condition, or the one nearest to
        that.
    """
    grid = _grid(model)
    if grid is None:
        return ()
    pairs = [
        (channel, _maps_of(model, grid, c, f"{key}-{channel}", title))
        for c, channel in enumerate(model.fit.problem.measurements.outputs)
        if channels is None or channel in channels
    ]
    if channels is None:
        pairs = [one for one in pairs if any(any(row) for row in one[1][1].strong)]
    return tuple(one for _, pair in pairs for one in pair)


@dataclass(frozen=True)
class _Grid:
    """The conditions as rows and columns, with their names."""

    points: list[tuple[float, float]]
    rows: list[float]
    columns: list[float]
    row_title: str
    column_title: str
    row_names: tuple[str, ...]
    column_names: tuple[str, ...]


def _grid(model: ModelComparison) -> _Grid | None:
    problem = model.fit.problem
    variables = problem.measurements.variables[:2]
    if not variables:
        return None
    units = variable_units(problem.measurements)
    values = [[record.condition.get(name, math.nan) for name in variables] for record in problem.records]
    points = [(_rounded(one[0]), _rounded(one[1]) if len(one) > 1 else 0.0) for one in values]
    rows, columns = (sorted({point[side] for point in points}) for side in (0, 1))
    across = len(variables) > 1
    return _Grid(
        points,
        rows,
        columns,
        _title(variables[0], units),
        _title(variables[1], units) if across else "",
        tuple(_shown(value, variables[0], units) for value in rows),
        tuple(_shown(value, variables[1], units) for value in columns) if across else ("all",),
    )


def _maps_of(model: ModelComparison, grid: _Grid, c: int, key: str, title: str) -> tuple[HeatMap, HeatMap]:
    """The bias of one channel, model less measured with its sign, and the size of its systematic error.

    The size is ``√(max(⟨(e/σ)²⟩ − 1, 0))``: it also shows an error that changes its sign within a record, so
    that its mean is zero. Conditions whose whitened residuals exceed chance are marked.
    """
    indices = range(len(grid.points))
    name = plain_name(model.fit.problem.measurements.outputs[c])
    errors = _pooled([model.fit.normalised_error(k)[:, c] for k in indices], grid)
    whitened = _pooled([whitened_errors(model.fit, k)[:, c] for k in indices], grid)
    strong = tuple(tuple(map(_stands_out, row)) for row in whitened)
    biased = tuple(tuple(map(_bias_stands_out, row)) for row in whitened)
    bias = tuple(tuple(float(one.mean()) if one.size else math.nan for one in row) for row in errors)
    size = tuple(tuple(map(_size, row)) for row in errors)

    def drawn(
        kind: str, description: str, values: Values, marks: Marks, limit: float, *, signed: bool
    ) -> HeatMap:
        return HeatMap(
            id=f"{key}-{kind}",
            caption=f"{title}{name}: {description}; * more than chance",
            row_title=grid.row_title,
            column_title=grid.column_title,
            rows=grid.row_names,
            columns=grid.column_names,
            values=values,
            strong=marks,
            limit=limit,
            signed=signed,
        )

    return (
        drawn(
            "bias", "bias, model − measured, in units of the noise", bias, biased, _BIAS_LIMIT, signed=True
        ),
        drawn("size", "systematic error, in units of the noise", size, strong, _LIMIT, signed=False),
    )


def _size(errors: Floats) -> float:
    return math.sqrt(max(float(np.mean(errors**2)) - 1.0, 0.0)) if errors.size else math.nan


def _bias_stands_out(errors: Floats) -> bool:
    """Whether the mean of whitened errors deviates by more than four standard deviations of chance."""
    return bool(errors.size) and abs(float(errors.mean())) > 4.0 / math.sqrt(errors.size)


def _pooled(errors: Sequence[Floats], grid: _Grid) -> list[list[Floats]]:
    """The errors of each condition, pooled over its records."""
    cells: dict[tuple[float, float], list[Floats]] = {}
    for error, point in zip(errors, grid.points, strict=True):
        cells.setdefault(point, []).append(error[np.isfinite(error)])
    return [[np.concatenate(cells.get((r, col), [np.empty(0)])) for col in grid.columns] for r in grid.rows]


def _stands_out(errors: Floats) -> bool:
    """Whether the whitened squares exceed those of noise by more than four standard deviations."""
    if not errors.size:
        return False
    return float(np.sqrt(np.mean(errors**2))) > 1.0 + 4.0 / math.sqrt(2.0 * errors.size)


def _rounded(value: float) -> float:
    return float(f"{value:.5g}")


def _title(name: str, units: dict[str, str]) -> str:
    unit = symbol(units.get(name, "1"))
    return f"{plain_name(name)} [{unit}]" if unit else plain_name(name)


def _shown(value: float, name: str, units: dict[str, str]) -> str:
    return significant(parse_unit(units.get(name, "1")).from_si(value), 3)
