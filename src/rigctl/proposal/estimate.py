"""Initial values of a template's parameters from the data, without simulation.

The equations are integrated over time, so that noise is averaged rather than differentiated, and are then
linear in the coefficients: ``y(t) − y(0) = Σ c_k·∫x_k dt``. The values are a starting point for a fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.proposal.columns import Column, Floats, Table


def integral(values: Floats, times: Floats, *, held: bool) -> Floats:
    """``∫ values dt`` from the first sample; a `held` value stays until the next, others are interpolated."""
    steps = np.diff(times)
    mean = values[:-1] if held else 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[0.0], np.cumsum(steps * mean)])


def rates(
    table: Table, of: Column, by: Sequence[tuple[Floats, bool]], *, order: int = 1
) -> tuple[Floats, float]:
    """``dy/dt = Σ c_k·x_k + c``, or ``d²y/dt²`` with `order` 2: the coefficients, SI, the constant last.

    Parameters
    ----------
    by: values of each x_k on the table's rows, and whether they hold between samples.

    Returns
    -------
    the coefficients, and the unexplained share of y's variance.
    """
    blocks, wanted = [], []
    count = len(by) + 1
    for rows in _pieces(table, of):
        times = table.times[rows] if table.times is not None else np.arange(float(rows.size))
        # ∫x_k dt, and t itself for the constant; for a second derivative twice. Each record has its own first
        # value, which is noisy, and for order 2 its own initial slope.
        columns = [integral(_bridged(values[rows], times), times, held=held) for values, held in by]
        columns.append(times - times[0])
        for _ in range(order - 1):
            columns = [integral(column, times, held=False) for column in columns]
        y = of.values[rows] - np.median(of.values[rows[:1]])
        local = [times - times[0]] if order == 2 else []
        local.append(np.ones(rows.size))  # the first sample has noise too
        blocks.append((np.column_stack(columns), np.column_stack(local)))
        wanted.append(y)
    if not blocks:
        return np.zeros(count), 1.0
    return _solve(blocks, wanted, count)


def _bridged(values: Floats, times: Floats) -> Floats:
    """The values, with straight lines across missing ones; 0 if all are missing."""
    good = np.isfinite(values)
    return np.interp(times, times[good], values[good]) if good.any() else np.zeros(values.size)


def _pieces(table: Table, of: Column) -> list[NDArray[np.intp]]:
    pieces = [rows[np.isfinite(of.values[rows])] for rows in table.pieces]
    return [rows for rows in pieces if rows.size >= 5]


def _solve(
    blocks: Sequence[tuple[Floats, Floats]], wanted: Sequence[Floats], count: int
) -> tuple[Floats, float]:
    """Least squares with the records' own columns taken out first."""
    shared, y = [], []
    for (columns, local), target in zip(blocks, wanted, strict=True):
        basis, _ = np.linalg.qr(local)
        shared.append(columns - basis @ (basis.T @ columns))
        y.append(target - basis @ (basis.T @ target))
    matrix, target = np.concatenate(shared), np.concatenate(y)
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    solution, *_ = np.linalg.lstsq(matrix / size, target, rcond=1e-10)
    rest = target - matrix / size @ solution
    total = float(target @ target) or 1.0
    return np.asarray(solution / size)[:count], float(rest @ rest) / total


def straight(table: Table, of: Column, by: Sequence[Floats]) -> Floats:
    """``y = Σ c_k·x_k + c``: the coefficients, SI, the constant last."""
    ok = np.isfinite(of.values) & np.all([np.isfinite(values) for values in by], axis=0)
    matrix = np.column_stack([*[values[ok] for values in by], np.ones(int(ok.sum()))])
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    solution, *_ = np.linalg.lstsq(matrix / size, of.values[ok], rcond=1e-10)
    return np.asarray(solution / size)
