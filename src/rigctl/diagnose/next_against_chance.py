"""Readings that would tell an effect from chance, in words: beyond the ends of a table, and repeats."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.adequacy import LEVEL
from rigctl.compare.localise import variable_units
from rigctl.compare.near_chance import near_chance
from rigctl.compare.result import ModelComparison
from rigctl.compare.scores import Score
from rigctl.compare.table_rows import short_condition
from rigctl.diagnose.alone import alone
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]

#: a reading shows what changes it by so many standard deviations
_SEEN = 3.0
#: chance to miss what repeats are meant to show
_MISSED = 0.1
_MOST_REPEATS = 20


def next_against_chance(before: ModelComparison) -> list[str]:
    """Sentences on readings that would tell what brings a model closer to a table, though as chance does."""
    found = []
    for score in near_chance(before.screening):
        found += _elsewhere(before, score)
        repeats = _repeats(before, score)
        if repeats:
            found.append(
                f"read each condition {repeats} times: {score.effect}, if it is as large as it seems, would "
                f"then stand out by {score.z * math.sqrt(repeats):.1f} sigma"
            )
    return found


def _elsewhere(before: ModelComparison, score: Score) -> list[str]:
    """Operating points beyond the table's ends at which an effect changes most."""
    problem = before.fit.problem
    points = _other_points(problem)
    if not points:
        return []
    tried = alone(before, before.linearisation.candidates[score.candidate], from_null=True)
    if tried is None:
        return []
    without, with_it = _at(before.fit, points), _at(tried.fit, points)
    apart = (with_it - without) / problem.noise.channels[0].sigma_at(without)
    output, units = problem.measurements.outputs[0], variable_units(problem.measurements)
    (name,) = problem.measurements.variables
    middle = float(np.mean([record.condition[name] for record in problem.records]))
    found = []
    for side in (1.0, -1.0):  # beyond the upper end, and below the lower one
        chosen = [k for k, point in enumerate(points) if side * (point[name] - middle) > 0.0]
        place = max(chosen, key=lambda k: abs(apart[k]), default=None)
        if place is not None and abs(apart[place]) > _SEEN:
            change = 100.0 * (with_it[place] / without[place] - 1.0)
            found.append(
                f"read {problem.measurements.titles.get(output, output)} at "
                f"{short_condition(points[place], units)} too: {score.effect} changes it there by "
                f"{change:+.0f} %, {abs(apart[place]):.0f} sigma of a reading"
            )
    return found


def _other_points(problem: Problem) -> list[dict[str, float]]:
    """Operating points of the family's standard record that lie next to the table's, and not in it.

    None of a table over several variables, nor of one whose rows have unknowns of their own.
    """
    standard = problem.model.family.standard_record
    names = problem.measurements.variables
    if standard is None or len(names) != 1 or any(problem.local):
        return []
    (name,) = names
    here = [record.condition[name] for record in problem.records]
    low, high = min(here), max(here)
    room = (high - low) / 3.0
    every = sorted({float(changed[name]) for _, changed in standard.switches if name in changed})
    return [{name: point} for point in every if low - room <= point < low or high < point <= high + room]


def _at(fit: FitResult, points: Sequence[Mapping[str, float]]) -> Floats:
    """(points) the first channel as a fitted model predicts it at other operating points."""
    problem = fit.problem
    first = problem.records[0]
    names = list(problem.measurements.inputs)
    records = []
    for point in points:
        inputs = first.inputs.copy()
        for name, value in point.items():
            inputs[:, names.index(name)] = value
        records.append(replace(first, inputs=inputs, condition=dict(point)))
    count = len(records)
    other = replace(
        problem,
        measurements=replace(problem.measurements, records=tuple(records)),
        local=((),) * count,
        starts=(problem.starts[0],) * count,
    )
    outputs = other.simulate(fit.values, [np.empty(0)] * count).require().outputs
    return np.array([float(array[-1, problem.channels[0]]) for array in outputs])


def _repeats(before: ModelComparison, score: Score) -> int:
    """How often each row must be read for an effect of its size to be told; 0 where that is out of reach."""
    from scipy.stats import norm, t

    channel = before.fit.problem.noise.channels[0]
    rows = len(before.fit.problem.records)
    if not channel.degrees:
        return 0
    for count in range(2, _MOST_REPEATS + 1):
        needed = float(t.isf(0.5 * LEVEL, channel.degrees + rows * (count - 1)) + norm.isf(_MISSED))
        if score.z * math.sqrt(count) > needed:
            return count
    return 0
