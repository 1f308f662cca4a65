"""The tolerance of an effect without explanatory variables: its size differs from record to record.

The law of an effect has a discrepancy over its variables (`rigctl.analysis.linear.shape_tolerance`). A delay,
a constant load or an offset has no variable, and never has exactly the same size twice. In record k, and for
a delay at each switch of it, the size is

    φ·(1 + b_k),   b_k ~ N(0, τ²)

with a column that is the effect's signature in that record and 0 elsewhere; for a delay, the signature of
that switch. Such scatter follows no operating point: a size that does depends on something, contrary to
the effect's law.

Source: N. M. Laird, J. H. Ware, Biometrics 38 (1982) 963, random effects beside fixed ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import (
    ALPHA,
    LEAST_DIFFERENCE,
    REVERSED_SIZES,
    SHAPE_TOLERANCE,
    SIZES_BEYOND_PRIOR,
    SPARE_SIZES,
)
from rigctl.analysis.linear.linearisation import Linearisation
from rigctl.analysis.linear.nuisance_projection import project
from rigctl.analysis.linear.slopes import base_at
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.fit.switching import MOST_SWITCHES, switch_name
from rigctl.model.measured.record import MeasuredRecord

Floats = NDArray[np.float64]

#: with more records no columns are added: their scatter averages out, and would take most of the matrix
_MOST_RECORDS = 100
#: standard deviations of a size that are tried
_WIDTHS = tuple(SHAPE_TOLERANCE * 2.0**k for k in range(4))
_RANK = 1e-9
#: largest relative difference between an effect's signature and the sum of its switches' in a record
_SAME = 0.02
#: half-width above which the time of a switch counts as unknown, s
_LEAST_HALF = 3e-4


def switch_columns(fit: FitResult, problem: Problem) -> tuple[list[str], list[Floats]]:
    """Names and (n, channels, switches) for each fitted record: derivatives by the time of each command.

    A delay may differ at each switch. Empty if records have many switches, or a command has no delay.
    `problem` is the same data with the equations of the whole library.

    Raises
    ------
    RigctlError
        the model cannot be simulated there.
    """
    inner = problem.only(fit.fitted)
    count = max((record.switch_times.size for record in inner.records), default=0)
    delayed = any(one.delay is not None for one in inner.model.family.inputs)
    if not delayed or not 1 < count <= MOST_SWITCHES:
        return [], []
    at = inner.with_shared((), base_at(inner, fit))
    records = tuple(replace(one, switch_half=_rough(one)) for one in at.records)
    at = replace(at, measurements=replace(at.measurements, records=records))
    names = [switch_name(k) for k in range(1, count)]
    simulated = at.simulate(np.empty(0), [fit.local[k] for k in fit.fitted], names).require()
    indices = [simulated.columns.index(name) for name in names]
    return names, [np.take(one, at.channels, axis=1)[:, :, indices] for one in simulated.sensitivities]


def _rough(record: MeasuredRecord) -> Floats:
    """Half-widths of the switches' times, raised to the least at which a time counts as unknown."""
    return np.asarray(np.maximum(record.switch_half, _LEAST_HALF))


def with_scatter(
    lin: Linearisation, effects: Sequence[tuple[str, Floats]], switches: int = 0
) -> Linearisation:
    """A linearisation with columns for the size of each effect in each record, after its other shapes.

    If switches at other times have the same signature in a record, there is one column for each switch.

    Parameters
    ----------
    effects: the name of each, and (nuisances + columns of S) the amplitudes of its parameters.
    switches: number of the last columns of S that are those of `switch_columns`: they are removed.
    """
    count = len(lin.records)
    plain = _without_last(lin, switches)
    if not effects or count > _MOST_RECORDS:
        return plain
    blocks: list[list[Floats]] = []
    names: list[str] = []
    for k, one in enumerate(lin.records):
        every = np.hstack([one.nuisance, one.signatures])
        moved = one.signatures[:, one.signatures.shape[1] - switches :]
        blocks.append([])
        for name, amplitudes in effects:
            parts = _parts(every @ amplitudes, moved)
            names += [column_name(name, k, part) for part in range(parts.shape[1])]
            blocks[k].append(parts)
    widths = [sum(part.shape[1] for part in parts) for parts in blocks]
    starts = np.cumsum([0, *widths])
    records, lengths = [], np.empty(starts[-1])
    for k, one in enumerate(plain.records):
        acts = np.hstack(blocks[k])
        more = np.zeros((len(acts), starts[-1]))
        more[:, starts[k] : starts[k + 1]] = acts
        lengths[starts[k] : starts[k + 1]] = np.linalg.norm(acts, axis=0)
        records.append(replace(one, signatures=np.hstack([one.signatures, more])))
    return replace(
        plain,
        records=tuple(records),
        full_lengths=np.concatenate([plain.full_lengths, lengths]),
        shapes=(*plain.shapes, *names),
    )


def _without_last(lin: Linearisation, columns: int) -> Linearisation:
    if not columns:
        return lin
    records = tuple(replace(one, signatures=one.signatures[:, :-columns]) for one in lin.records)
    return replace(
        lin, records=records, full_lengths=lin.full_lengths[:-columns], shapes=lin.shapes[:-columns]
    )


def _parts(acts: Floats, moved: Floats) -> Floats:
    """(rows, parts) an effect's signature in a record: by switches if these are all of it."""
    lengths = np.linalg.norm(moved, axis=0)
    length = float(np.linalg.norm(acts))
    shown = np.flatnonzero(lengths > 0.0)
    if not shown.size or not length > 0.0:
        return acts[:, None]
    unit = moved[:, shown] / lengths[shown]
    sizes = np.linalg.lstsq(unit, acts, rcond=_RANK)[0]
    if float(np.linalg.norm(acts - unit @ sizes)) > _SAME * length:
        return acts[:, None]
    kept = np.abs(sizes) > _SAME * float(np.abs(sizes).max())
    return np.asarray(unit[:, kept] * sizes[kept])


def column_name(effect: str, record: int, part: int = 0) -> str:
    """The name of a column of one effect in one record."""
    return f"size of {effect} in record {record}, {part}"


def _records_of(lin: Linearisation, effect: str) -> dict[str, int]:
    """The columns of one effect among the shapes, and the record of each."""
    known = set(lin.shapes)
    parts = range(MOST_SWITCHES)
    every = {column_name(effect, k, part): k for k in range(len(lin.records)) for part in parts}
    return {name: k for name, k in every.items() if name in known}


@dataclass(frozen=True)
class SizeScatter:
    """How much the size of an effect without explanatory variables differs from record to record.

    Attributes
    ----------
    effect: its name.
    width: standard deviation of b, the most likely of a few values, of which the shape tolerance is the
        smallest.
    asked: the data support it: its evidence is a hundred to one.
    follows: the sizes follow the operating point, so that the effect depends on something.
    explained: the reduction of χ² by it.
    counts: it may count as explained by the effect: the data support it, hardly any size has the opposite
        sign of the mean, they are no wider than the prior allows, and enough of them follow neither an
        operating variable nor a square or product of them.
    """

    effect: str
    width: float
    asked: bool
    follows: bool
    explained: float = 0.0
    counts: bool = False


def size_scatter(lin: Linearisation, effect: str) -> SizeScatter | None:
    """The scatter of one effect's size; None if it has no such columns.

    Parameters
    ----------
    lin: with the shapes, unscaled, as its last columns.
    """
    names = _records_of(lin, effect)
    if not names:
        return None
    # Everything else is projected off. With A = S̃ᵀS̃ and g = S̃ᵀr̃ the evidence is that of b ~ N(0, τ²I), at
    # the most likely of a few τ; choosing among them costs 2·ln of their number.
    projected = project(lin)
    first = projected.signatures.shape[1] - len(lin.shapes)
    columns = projected.signatures[:, [first + lin.shapes.index(name) for name in names]]
    square, slope = columns.T @ columns, columns.T @ projected.residual
    costs = {width: _evidence(width**2 * square, width * slope) for width in _WIDTHS}
    width = min(costs, key=lambda one: costs[one])
    required = costs[width] + 2.0 * math.log(len(_WIDTHS)) < -LEAST_DIFFERENCE
    sizes: Floats = np.asarray(np.linalg.solve(square + np.eye(len(names)) / width**2, slope))
    # A size that follows the operating point is no scatter: the effect then depends on something, contrary to
    # its law. `follows` speaks against the effect, `counts` lets the scatter count as explained by it.
    conditions = lin.regions.conditions[list(names.values())]
    weights = np.sqrt(np.diag(square))
    follows = required and _trend_chance(sizes, weights, conditions, 1) < ALPHA
    steady = all(_trend_chance(sizes, weights, conditions, degree) >= ALPHA for degree in (1, 2))
    plausible = (
        float(np.mean(sizes < -1.0)) <= REVERSED_SIZES
        and math.sqrt(float(np.mean(np.square(sizes)))) <= SIZES_BEYOND_PRIOR * width
        and sizes.size - conditions.shape[1] - 1 >= SPARE_SIZES
    )
    return SizeScatter(
        effect,
        width,
        required,
        follows,
        explained=max(0.0, float(slope @ sizes)),
        counts=required and steady and plausible,
    )


def _evidence(matrix: Floats, slope: Floats) -> float:
    """``−gᵀ(I + A)⁻¹g + ln|I + A|``."""
    total = matrix + np.eye(slope.size)
    return float(np.linalg.slogdet(total)[1]) - float(slope @ np.linalg.solve(total, slope))


def _trend_chance(sizes: Floats, weights: Floats, conditions: Floats, degree: int) -> float:
    """p-value of the sizes' dependence on the operating variables, by an F test against what is left.

    Each size is weighted by the information that the readings contain about it. With `degree` 2 the squares
    and products of the variables are tested as well; 1.0 if too few sizes are left for the test.
    """
    from scipy.special import fdtrc

    count = conditions.shape[1]
    products = [conditions[:, i] * conditions[:, j] for i in range(count) for j in range(i, count)]
    surface = [np.ones(sizes.size), *conditions.T, *(products if degree > 1 else ())]
    left, values, _ = np.linalg.svd(np.column_stack(surface) * weights[:, None], full_matrices=False)
    span = left[:, values > _RANK * max(float(values[0]), 1e-300)]
    mean = weights / max(float(np.linalg.norm(weights)), 1e-300)
    weighted = weights * sizes
    weighted = weighted - mean * float(mean @ weighted)
    explained = float(np.square(span.T @ weighted).sum())
    residual, free = float(weighted @ weighted) - explained, sizes.size - span.shape[1]
    if span.shape[1] < 2 or free < 1 or not explained > 0.0:
        return 1.0
    ratio = (explained / (span.shape[1] - 1)) / max(residual / free, 1e-300)
    return float(fdtrc(span.shape[1] - 1, free, ratio))
