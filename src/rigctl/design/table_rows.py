"""The rows to add to a table of single values: operating points at which the rivals differ most.

In: the question that a table leaves open. Out: a `DesignResult` of rows. A row is a single
value at an operating point, so nothing but the point is varied. A row has no procedure and no bench time,
because how it was taken was not recorded.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from rigctl.design.criterion import Discrimination
from rigctl.design.information import Evidence
from rigctl.design.information_so_far import known_so_far
from rigctl.design.power import Gain
from rigctl.design.refusals import NothingLeft
from rigctl.design.result import HALF, DesignResult, PredictedPower, ProposedRecord
from rigctl.design.rivals import Basis, Question
from rigctl.design.scheme import Free, allowed, tenth
from rigctl.design.virtual_records import predict
from rigctl.model.inputs import input_sources
from rigctl.model.measured.conditions import variable_units
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.rig.rig import Rig
from rigctl.rig.setting import POSITIONS
from rigctl.units import parse_unit, show
from rigctl.wording import listed, noun

#: number of values of each variable, and how far they go beyond the table's range, as a share of its width
_VALUES, _BEYOND = 9, 0.25
#: D of all candidates together, nothing else known, below which a model fits whatever another one predicts
_NOTHING = 1.0
#: a set is complete at this probability
_ENOUGH = 0.95


@dataclass(frozen=True)
class _Row:
    """A row that has not been measured."""

    point: Mapping[str, float]
    evidence: Evidence


def design_rows(basis: Basis, question: Question, most: int) -> DesignResult:
    """The most informative rows, one after the other, each given the information in those before it.

    Only for rivals that are to be distinguished.
    """
    known = known_so_far(question.rivals)
    criterion = Discrimination(question, known)
    measurements = question.rivals[0].fit.problem.measurements
    # As for records, without what rows do not have: schemes, limits, bench time, draws.
    candidates = _candidates(question, measurements)
    if basis.diagnosis is None:
        question = _within_reach(criterion, _evidence(candidates))
        criterion = Discrimination(question, known)
    chosen = _chosen(criterion, candidates, most)
    steps = [_evidence(chosen[:count]) for count in range(len(chosen) + 1)]
    chances = [0.0 if one is None else criterion.predicted_probability(one) for one in steps]
    separations = [0.0 if one is None else criterion.separation(one) for one in steps]
    repeats = [one for one in known.repeats if one is not None]
    units = variable_units(measurements)
    title = measurements.titles.get(measurements.outputs[0], measurements.outputs[0])
    rows = tuple(
        ProposedRecord(
            settings={name: show(value, units[name], digits=4) for name, value in row.point.items()},
            steps=(f"read {title}",),
            separation=separations[k + 1] - separations[k],
            of_repeat=_of_repeat(criterion, steps[k], repeats),
            before=chances[k],
            after=chances[k + 1],
            duration=0.0,
            recorded=0.0,
            rate=0.0,
        )
        for k, row in enumerate(chosen)
    )
    return DesignResult(
        runs=basis.runs,
        model=basis.model,
        aim="discrimination",
        rivals=tuple(rival.described() for rival in question.rivals),
        outlooks=_outlooks(criterion, steps[-1]),
        records=rows,
        separation=separations[-1],
        before=chances[0],
        after=chances[-1],
        duration=0.0,
        diagnosis=basis.diagnosis,
        excluded=basis.excluded,
    )


def _within_reach(criterion: Discrimination, every: Evidence | None) -> Question:
    """The question without pairs of models that no rows would distinguish, since the rival contains it.

    A rival contains the other one if it has more parameters, and fits all the rows at once as that one
    predicts them, whatever the data so far say of its parameters.

    Raises
    ------
    NothingLeft
        all others left contain the most probable one, and if one of them were right, as it is fitted now, not
        even all the rows at once would show it.
    """
    question = criterion.question
    if every is None:
        return question
    free = np.array([len(one.fit.problem.shared) for one in question.rivals])
    contained = (every.distances(criterion.known.prior) < _NOTHING) & (free[:, None] < free)
    distances = criterion.distances(every)
    more = [
        criterion.of_pair((j, 0), Gain(distances[j, :1], distances[j, :1]), distances)
        for j in range(1, free.size)
    ]
    if all(contained[0, 1:]) and max(more) < HALF:
        best, *others = (one.name for one in question.rivals)
        raise NothingLeft(
            f"nothing is left to distinguish: {best} is the simplest model that these data leave; "
            f"{listed(others)} {noun(len(others), 'fits', 'fit')} whatever {best} predicts",
            value=best,
        )
    return replace(question, pairs=tuple(pair for pair in question.pairs if not contained[pair]))


def _candidates(question: Question, measurements: Measurements) -> list[_Row]:
    """Rows over a grid of the table's variables, as far as every rival can be simulated."""
    fit = question.rivals[0].fit
    rows = [measurements.records[k] for k in fit.fitted]
    grid = [(name, _values(name, rows, measurements)) for name in measurements.variables]
    points = [dict(zip([n for n, _ in grid], each, strict=True)) for each in product(*(v for _, v in grid))]
    records = [_row(point, _nearest(point, rows), question) for point in points]
    scenes = predict(question.rivals, records)
    return [
        _Row(point, Evidence.of(scene.responses))
        for point, scene in zip(points, scenes, strict=True)
        if scene is not None
    ]


def _values(name: str, rows: Sequence[MeasuredRecord], measurements: Measurements) -> list[float]:
    """The values of one variable, over the table's range and a little beyond, within the rig's limits.

    Of a switch or a valve they are its positions.
    """
    actuator = measurements.rig.actuators.get(name) if measurements.rig is not None else None
    if actuator is not None and actuator.kind in POSITIONS:
        return sorted(POSITIONS[actuator.kind].values())
    values = [row.condition[name] for row in rows if name in row.condition]
    width = max(values) - min(values)
    low, high = _allowed(name, min(values) - _BEYOND * width, max(values) + _BEYOND * width, measurements.rig)
    unit = variable_units(measurements)[name]
    step = tenth((high - low) / parse_unit(unit).factor / _VALUES)
    free = Free(name, low, high, unit, step)
    return sorted({free.at(share) for share in np.linspace(0.0, 1.0, _VALUES)})


def _allowed(name: str, low: float, high: float, rig: Rig | None) -> tuple[float, float]:
    if rig is None:
        return low, high
    actuator = rig.actuators.get(name)
    if actuator is not None and actuator.low is not None and actuator.high is not None:
        low, high = max(low, float(actuator.low)), min(high, float(actuator.high))
    return allowed(rig, name, low, high) if name in rig.channels else (low, high)


def _nearest(point: Mapping[str, float], rows: Sequence[MeasuredRecord]) -> MeasuredRecord:
    """The row of the table nearest to a new one: it supplies what the new point leaves open."""

    def distance(row: MeasuredRecord) -> float:
        return sum(
            abs(row.condition.get(name, math.inf) / value - 1.0) for name, value in point.items() if value
        )

    return min(rows, key=distance)


def _row(point: Mapping[str, float], like: MeasuredRecord, question: Question) -> MeasuredRecord:
    """A row at another operating point: the inputs that set it, and the rest of its condition."""
    problem = question.rivals[0].fit.problem
    model, measurements = problem.model, problem.measurements
    inputs = like.inputs.copy()
    if measurements.rig is not None:
        fixed_inputs = {name: value for name, value in model.values.items() if name in measurements.inputs}
        for k, source in enumerate(input_sources(model.family, measurements.rig, fixed_inputs)):
            for name, factor in source.actuators:
                if name in point:
                    inputs[:, k] += factor * (point[name] - like.condition[name])
    for name, value in point.items():
        if name in measurements.inputs:
            inputs[:, measurements.inputs.index(name)] = value
    nothing = np.full(like.values.shape, np.nan)
    return replace(like, inputs=inputs, values=nothing, condition={**like.condition, **point})


def _chosen(criterion: Discrimination, candidates: Sequence[_Row], most: int) -> list[_Row]:
    """The rows chosen greedily, until the right rival would be named reliably."""
    chosen: list[_Row] = []
    while len(chosen) < most and candidates:
        so_far = _evidence(chosen)
        evidence = [one.evidence if so_far is None else so_far + one.evidence for one in candidates]
        k = max(range(len(evidence)), key=lambda k: criterion.worth(evidence[k]))
        if criterion.worth(evidence[k]) <= (0.0 if so_far is None else criterion.worth(so_far)):
            break
        chosen.append(candidates[k])
        if criterion.predicted_probability(evidence[k]) >= _ENOUGH:
            break
    return chosen


def _evidence(chosen: Sequence[_Row]) -> Evidence | None:
    return Evidence.total(one.evidence for one in chosen) if chosen else None


def _of_repeat(criterion: Discrimination, so_far: Evidence | None, repeats: Sequence[Evidence]) -> float:
    base = 0.0 if so_far is None else criterion.separation(so_far)
    candidates = [one if so_far is None else so_far + one for one in repeats]
    return max((criterion.separation(one) - base for one in candidates), default=0.0)


def _outlooks(criterion: Discrimination, evidence: Evidence | None) -> tuple[PredictedPower, ...]:
    rivals = criterion.question.rivals
    count = len(rivals)
    distances = np.zeros((count, count)) if evidence is None else criterion.distances(evidence)
    outlooks = []
    for pair in criterion.pairs:
        gained = Gain(distances[pair][None], distances[pair][None])
        outlooks.append(
            PredictedPower(
                truth=rivals[pair[0]].name,
                rival=rivals[pair[1]].name,
                margin=criterion.margins.margin(*pair),
                threshold=criterion.margins.threshold(pair[0], distances),
                separation=float(distances[pair]),
                spread=0.0,
                before=0.0,
                after=criterion.of_pair(pair, gained, distances),
            )
        )
    return tuple(outlooks)
