"""Compute the set-point that keeps a quantity at its target over an operating variable.

At each operating point x the model's prediction q(x, u) is solved for ``q(x, u) = q*``. The set-point's
standard deviation follows from that of the prediction due to the fitted parameters, ``σ_u =
√(gᵀΣg)/|∂q/∂u|``; the record-level variation of the quantity itself is added separately.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison import compare
from rigctl.analysis.fitting import OnProgress, no_progress
from rigctl.compensation.check import check_of
from rigctl.compensation.levers import Lever, lever, levers_of, require_levers
from rigctl.compensation.measured import TakenMeasure, Target, find_measure, require_measure
from rigctl.compensation.prediction import Predictor
from rigctl.compensation.result import CompensationRow, RangeEnd, Schedule
from rigctl.dataset.run import Run
from rigctl.design.scheme import stage_of
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.rigs import rig_of
from rigctl.model.model import Model
from rigctl.rig.rig import Rig
from rigctl.units import parse_unit, show

Floats = NDArray[np.float64]

#: number of rows of a schedule, and of set-points at which the quantity is first evaluated
ROWS, _LOOKED_AT = 7, 7
#: number of iterations to find a set-point within its bracket
_STEPS = 10
#: a quantity depends on the set-point if it changes by at least this share of its scatter over all set-points
_NOTHING = 0.1


def compensate(
    runs: Sequence[Run],
    model: Model,
    *,
    keep: str,
    vary: str,
    over: str,
    rows: int = ROWS,
    seed: int = 0,
    on_progress: OnProgress | None = None,
) -> Schedule:
    """The schedule of `vary` over `over` that keeps a measure at its target, by a model fitted to `runs`.

    Parameters
    ----------
    keep: ``stroke = 110 mm``: a measure that the procedure of the runs computes in its records, and its
        value.
    vary: what is set, a channel with a `set_pressure` or an actuator; `over` the operating variable.
    seed: of the random order of the records that check it.

    Raises
    ------
    RigctlError
        the runs have no such measure, or the model predicts none of its channels; nothing of that name can be
        set; setting it changes nothing; the target is out of reach everywhere.
    """
    report = on_progress or no_progress
    # 1. Everything that can be refused without a fit.
    target = Target.read(keep)
    require_measure(runs, target.name)  # this and what follows before a fit of minutes
    rig = rig_of(model, runs) or model.rig
    if rig is None:
        raise RigctlError("these runs are of no rig, so that nothing can be set", value=runs[0].id)
    require_levers(rig, model.family, {"--vary": vary, "--over": over})
    measure = find_measure(runs, rig, target)
    _require_dimension(measure, target)
    # 2. The model fitted to the runs, and whether it agrees: a schedule is no better than its model.
    compared = compare(runs, [model], on_progress=on_progress)
    (judged,) = compared.models
    fit = judged.fit
    _require_predicted(measure, target, fit)
    report("Computing the set-points")
    # 3. q(x, u) by simulation, solved for u at each operating point within the measured range.
    predictor = _predictor(fit, rig, measure, vary, over)
    solution = _solved(predictor, target, _range(predictor.over, fit), max(rows, 2))
    valid = tuple((one.name, *_range(one, fit), one.unit) for one in (predictor.over, predictor.vary))
    return Schedule(
        runs=tuple(run.id for run in runs),
        model=judged.name,
        quantity=target.name,
        target=target.value,
        unit=target.unit,
        vary=predictor.vary.name,
        vary_unit=predictor.vary.unit,
        over=predictor.over.name,
        over_unit=predictor.over.unit,
        rows=solution.rows,
        fixed=solution.fixed,
        off=solution.off,
        valid=valid,
        ends=tuple(_ends(solution, predictor, target)),
        disagreement=None if judged.adequate else judged.adequacy.p_value,
        check=check_of(solution.rows, solution.fixed, measure, predictor, runs, seed),
    )


def _require_predicted(measure: TakenMeasure, target: Target, fit: FitResult) -> None:
    outputs = fit.problem.measurements.outputs
    for channel in measure.channels:
        if channel not in outputs:
            raise RigctlError(
                f"the model does not give '{target.name}': it does not predict the channel of it",
                value=channel,
                expected=f"a measure of {', '.join(outputs)}",
            )


def _require_dimension(measure: TakenMeasure, target: Target) -> None:
    unit = parse_unit(measure.measure.unit)
    if unit.dimension != parse_unit(target.unit).dimension:
        raise RigctlError(
            f"'{target.name}' is measured in another dimension",
            value=target.unit or "no unit",
            expected=unit.text,
        )


def _predictor(fit: FitResult, rig: Rig, measure: TakenMeasure, vary: str, over: str) -> Predictor:
    stage = stage_of(fit, rig)
    records, outputs = fit.problem.records, fit.problem.measurements.outputs
    known = levers_of(stage, records, outputs)
    varied, drifting = lever(known, vary, "--vary"), lever(known, over, "--over")
    if varied.inputs == drifting.inputs and varied.role == drifting.role:
        raise RigctlError("what is varied and what it is varied over are the same", value=vary)
    if not varied.inputs:
        raise RigctlError(
            f"'{vary}' is brought about slowly, and is no set-point",
            value=vary,
            expected="one that a record begins with",
        )
    indices = [k for k in fit.fitted if (records[k].run, records[k].index) in measure.arguments]
    if not indices:
        raise RigctlError("no fitted record takes this measure", value=measure.measure.name)
    template = records[indices[0]]
    for one in (varied, drifting):
        if not one.steady(template):
            raise RigctlError(
                "it changes within the records, so that there is no one set-point",
                value=one.name,
                expected="records in which it stays",
            )
    return Predictor(fit, stage, measure, template, varied, drifting)


def _range(one: Lever, fit: FitResult) -> tuple[float, float]:
    """Range of one quantity in the fitted records."""
    outputs = fit.problem.measurements.outputs
    values = np.array([one.of(fit.problem.records[k], outputs) for k in fit.fitted])
    values = values[np.isfinite(values)]
    if not values.size or float(np.ptp(values)) <= 1e-6 * float(np.abs(values).max(initial=0.0)):
        raise RigctlError(
            "all records are at one value of it, so that the model is tested at no other",
            value=one.name,
            expected="records over the range that the schedule is for",
        )
    return float(values.min()), float(values.max())


@dataclass(frozen=True)
class _Solved:
    """The rows, and `reach` (rows, 2), the quantity at the lowest and at the highest set-point."""

    rows: tuple[CompensationRow, ...]
    fixed: float
    off: float
    reach: Floats = field(repr=False)


def _solved(predictor: Predictor, target: Target, span: tuple[float, float], count: int) -> _Solved:
    at = np.linspace(*span, count)
    low, high = predictor.vary.low, predictor.vary.high
    # A coarse grid over all set-points first: it shows whether the set-point matters, whether the target is
    # reached, and brackets each solution.
    grid = np.linspace(low, high, _LOOKED_AT)
    values = predictor.values([(x, u) for x in at for u in grid]).reshape(count, grid.size)
    middle = predictor.with_spread([(float(at[count // 2]), float(grid[grid.size // 2]))])[0]
    if float(np.ptp(values, axis=1).max()) <= _NOTHING * math.hypot(middle.common, middle.scatter):
        raise RigctlError(
            f"setting '{predictor.vary.name}' does not change '{target.name}' in this model",
            value=predictor.vary.name,
        )
    set_points = _roots(predictor, at, grid, values - target.value, target)
    reached = np.isfinite(set_points)
    if not reached.any():
        raise RigctlError(
            f"the rig does not reach this '{target.name}' at any operating point",
            value=show(target.value, target.unit),
            expected=f"{show(float(values.min()), target.unit)} to {show(float(values.max()), target.unit)}",
        )
    nearest = int(np.flatnonzero(reached)[np.argmin(np.abs(np.flatnonzero(reached) - count // 2))])
    fixed = float(set_points[nearest])
    return _Solved(
        tuple(_rows(predictor, at, set_points, fixed)),
        fixed,
        _between(predictor, at, set_points, target),
        values[:, [0, -1]],
    )


def _roots(predictor: Predictor, at: Floats, grid: Floats, excess: Floats, target: Target) -> Floats:
    """(points) where the quantity equals the target, by regula falsi (Illinois) at all points at once; NaN if
    nowhere."""
    sides: list[tuple[int, float, float, float, float]] = []
    for row, one in enumerate(excess):
        crossing = np.flatnonzero(np.sign(one[:-1]) * np.sign(one[1:]) <= 0.0)
        if crossing.size:
            k = int(crossing[0])
            sides.append((row, float(grid[k]), float(grid[k + 1]), float(one[k]), float(one[k + 1])))
    roots = np.full(at.size, np.nan)
    for _ in range(_STEPS):
        if not sides:
            break
        # Illinois: the value at the side that stays is halved, so that a strongly curved q does not stall at
        # it.
        tried = [
            (row, (a * fb - b * fa) / (fb - fa) if fb != fa else 0.5 * (a + b)) for row, a, b, fa, fb in sides
        ]
        deviations = predictor.values([(float(at[row]), u) for row, u in tried]) - target.value
        narrower = []
        for (row, a, b, fa, fb), (_, u), f in zip(sides, tried, deviations.tolist(), strict=True):
            roots[row] = u
            narrower.append((row, a, u, 0.5 * fa, f) if f * fb > 0.0 else (row, u, b, f, 0.5 * fb))
        sides = narrower
    return roots


def _rows(predictor: Predictor, at: Floats, set_points: Floats, fixed: float) -> list[CompensationRow]:
    width = 1e-3 * (predictor.vary.high - predictor.vary.low)
    reached = [k for k, u in enumerate(set_points) if math.isfinite(u)]
    operating_points = [(float(at[k]), float(set_points[k])) for k in reached]
    points = predictor.with_spread(operating_points)
    beside = [(x, u + side * width) for x, u in operating_points for side in (-1.0, 1.0)]
    # ∂q/∂u by central differences, with which the uncertainty of q becomes one of u.
    slopes = np.diff(predictor.values(beside).reshape(-1, 2), axis=1)[:, 0] / (2.0 * width)
    unchanged = predictor.values([(float(x), fixed) for x in at])
    by_row = dict(zip(reached, zip(points, slopes.tolist(), strict=True), strict=True))
    rows = []
    for k, x in enumerate(at.tolist()):
        if k not in by_row:
            rows.append(CompensationRow(x, math.nan, math.nan, math.nan, math.nan, float(unchanged[k])))
            continue
        point, slope = by_row[k]
        std = point.common / abs(slope) if slope else math.inf
        rows.append(
            CompensationRow(x, float(set_points[k]), std, point.value, point.scatter, float(unchanged[k]))
        )
    return rows


def _between(predictor: Predictor, at: Floats, set_points: Floats, target: Target) -> float:
    """The largest error of the quantity halfway between two rows, with the set-point interpolated."""
    halfway = [
        (0.5 * float(at[k] + at[k + 1]), 0.5 * float(set_points[k] + set_points[k + 1]))
        for k in range(at.size - 1)
        if math.isfinite(set_points[k] + set_points[k + 1])
    ]
    return float(np.abs(predictor.values(halfway) - target.value).max()) if halfway else 0.0


def _ends(solution: _Solved, predictor: Predictor, target: Target) -> list[RangeEnd]:
    """Where the rig's range is insufficient, for each range of operating points."""
    vary, ends = predictor.vary, []
    stretch: list[int] = []
    for k, row in enumerate([*solution.rows, None]):
        if row is not None and not row.reached:
            stretch.append(k)
        elif stretch:
            first, last = stretch[0], stretch[-1]
            off = solution.reach[stretch] - target.value
            side = int(np.argmin(np.abs(off).sum(axis=0)))
            beside = [one for one in (first - 1, last + 1) if 0 <= one < len(solution.rows)]
            ends.append(
                RangeEnd(
                    at=tuple(_crossing(solution, one, stretch, side, target) for one in beside),
                    first=solution.rows[first].over,
                    last=solution.rows[last].over,
                    bound=(vary.low, vary.high)[side],
                    side="highest" if side else "lowest",
                    becomes=(float(solution.reach[first, side]), float(solution.reach[last, side])),
                )
            )
            stretch = []
    return ends


def _crossing(solution: _Solved, inside: int, stretch: Sequence[int], side: int, target: Target) -> float:
    """The operating point between a row that is reached and the next, which is not, at which the end of the
    rig's range is just sufficient."""
    outside = stretch[0] if inside < stretch[0] else stretch[-1]
    a, b = (float(solution.reach[one, side]) - target.value for one in (inside, outside))
    x, y = solution.rows[inside].over, solution.rows[outside].over
    return x + (y - x) * a / (a - b) if a != b else x
