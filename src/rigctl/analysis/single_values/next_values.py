"""What to measure next after a table: other channels, points beyond its ends or between, repeats.

For the effects that explain a table equally well, the changes that they would make to further readings are
compared. Differences for which the fitted parameters could compensate are not subtracted: what is named here
separates the effects at best.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.agreement.trends import Trend
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.linear.power import significant_size
from rigctl.analysis.linear.score_test import Score
from rigctl.analysis.search.refit_alone import alone
from rigctl.analysis.single_values.findings import near_chance
from rigctl.analysis.single_values.rows import short_condition
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.conditions import variable_units

Floats = NDArray[np.float64]

#: readings that differ by this many times their noise are distinguished without statistics
_PLAIN = 10.0
#: number of samples of a simulated record
_SAMPLES = 150
#: noise of a channel that is known neither from the rig nor from a channel of the same unit, as a share of
#: its change
_UNKNOWN = 0.01


@dataclass(frozen=True)
class ChannelOverTime:
    """One channel recorded over time: the groups of effects that it would distinguish, and by how much.

    `once`: so far it was read once at each operating point.
    """

    channel: str
    groups: tuple[tuple[str, ...], ...]
    apart: float
    unit: str
    once: bool


@dataclass(frozen=True)
class SecondMeasurement:
    """A quantity measured independently of the bench's sensor: no channel distinguishes these effects."""

    quantity: str
    effects: tuple[str, ...]


@dataclass(frozen=True)
class FurtherPoint:
    """A reading beyond the table's ends, where an effect changes it most: by a share, and times its noise."""

    quantity: str
    condition: str
    effect: str
    change: float
    times: float


@dataclass(frozen=True)
class Repeats:
    """So many readings of each condition, with which an effect as large as it seems has this size."""

    readings: int
    effect: str
    size: float


@dataclass(frozen=True)
class MoreValues:
    """Further values of a variable, which has only these one or two, SI."""

    variable: str
    values: tuple[float, ...]
    unit: str


@dataclass(frozen=True)
class RepeatedConditions:
    """Each condition three times: so far the noise is only guessed."""


NextStep: TypeAlias = (
    ChannelOverTime | SecondMeasurement | FurtherPoint | Repeats | MoreValues | RepeatedConditions
)


def next_channels(
    before: ModelComparison, trend: Trend | None, members: Mapping[str, FitResult]
) -> list[NextStep]:
    """Channels that would distinguish effects which a table does not.

    Parameters
    ----------
    trend: the change that all of them explain.
    members: the fit of each effect.
    """
    problem = before.fit.problem
    if len(members) < 2 or trend is None or problem.model.family.standard_record is None:
        return []
    parts = _parts(before, trend, members)
    telling = [part for part in parts if len(part.groups) > 1]
    return [*telling, *_never_parted(parts, list(members), trend.quantity)]


def _parts(before: ModelComparison, trend: Trend, members: Mapping[str, FitResult]) -> list[ChannelOverTime]:
    """For every channel that the bench could have, the groups by their change over the trend's variable."""
    channels = _channels(before.fit.problem)
    changes = {name: _changes(fit, trend, channels) for name, fit in members.items()}
    parts = []
    for index, output in enumerate(channels):
        noise = _noise(before, output, [change[:, :, index] for change in changes.values()])
        distances = {
            (one, other): float(np.abs(changes[one][:, :, index] - changes[other][:, :, index]).max())
            for one in members
            for other in members
        }
        groups = _groups(list(members), {pair: value > _PLAIN * noise for pair, value in distances.items()})
        once = output in before.fit.problem.measurements.outputs
        parts.append(ChannelOverTime(output, groups, max(distances.values()), _unit(before, output), once))
    return parts


def _channels(problem: Problem) -> tuple[str, ...]:
    """The channels of the bench, then those known to the family that read one of its states."""
    system = problem.compiled.system
    more = [item.name for item in problem.model.family.outputs if item.name not in system.output_names]
    return (*system.output_names, *(name for name in more if name in system.state_names))


def _changes(fit: FitResult, trend: Trend, channels: Sequence[str]) -> Floats:
    """(other conditions, samples, channels) readings at the variable's high end less those at its low end."""
    problem = fit.problem
    # Simulated without noise, with the record-level unknowns at their starts, over the commands of the
    # table's own records: the change over the trend's variable, which all of the effects explain, as each
    # channel shows it.
    length = float(problem.records[0].switch_times[-1]) + 1.0
    times = np.linspace(0.0, length, _SAMPLES)[1:]
    records = tuple(
        replace(
            record,
            times=times,
            values=np.full((times.size, record.values.shape[1]), np.nan),
            phase=np.zeros(times.size, dtype=np.intp),
        )
        for record in problem.records
    )
    course = replace(problem, measurements=replace(problem.measurements, records=records))
    local = [
        np.array([unknown.start for unknown in record_local]) for record_local in problem.local_unknowns()
    ]
    simulated = course.simulate(fit.values, local).require()
    system = problem.compiled.system
    states = [system.state_names.index(name) for name in channels[len(system.output_names) :]]
    outputs = [
        np.concatenate([output, state[:, states]], axis=1)
        for output, state in zip(simulated.outputs, simulated.states, strict=True)
    ]
    pairs: dict[tuple[float, ...], dict[float, int]] = {}
    for index, record in enumerate(records):
        others = tuple(value for name, value in sorted(record.condition.items()) if name != trend.variable)
        pairs.setdefault(others, {})[record.condition.get(trend.variable, math.nan)] = index
    return np.array(
        [outputs[pair[max(pair)]] - outputs[pair[min(pair)]] for pair in pairs.values() if len(pair) > 1]
    )


def _noise(before: ModelComparison, output: str, changes: Sequence[Floats]) -> float:
    """The noise of a channel, SI: from the rig, else from a channel of the same unit, else a share of its
    change."""
    rig = before.fit.problem.measurements.rig
    units = {item.name: item.unit for item in before.fit.problem.model.family.outputs}
    if rig is not None:
        known = {name: channel.noise_level for name, channel in rig.channels.items() if channel.noise_level}
        if output in known:
            return known[output]
        alike = [value for name, value in known.items() if units.get(name) == units[output]]
        if alike:
            return max(alike)
    return _UNKNOWN * max(float(np.abs(change).max()) for change in changes) or 1.0


def _unit(before: ModelComparison, output: str) -> str:
    rig = before.fit.problem.measurements.rig
    units = {item.name: item.unit for item in before.fit.problem.model.family.outputs}
    if rig is None:
        return units[output]
    if output in rig.channels:
        return rig.channels[output].unit
    alike = [channel.unit for name, channel in rig.channels.items() if units.get(name) == units[output]]
    return alike[0] if alike else units[output]


def _groups(names: list[str], separable: Mapping[tuple[str, str], bool]) -> tuple[tuple[str, ...], ...]:
    """Groups of names that are indistinguishable, directly or through others."""
    groups: list[list[str]] = []
    for name in names:
        near = [group for group in groups if any(not separable[(name, other)] for other in group)]
        merged = [other for group in near for other in group]
        groups = [group for group in groups if group not in near] + [[*merged, name]]
    return tuple(tuple(group) for group in groups)


def _never_parted(parts: Sequence[ChannelOverTime], names: list[str], quantity: str) -> list[NextStep]:
    """Effects that no channel of the bench would distinguish."""
    separable = {
        (one, other): any(not any(one in group and other in group for group in part.groups) for part in parts)
        for one in names
        for other in names
    }
    return [SecondMeasurement(quantity, group) for group in _groups(names, separable) if len(group) > 1]


#: a reading shows a change of this many standard deviations
_SEEN = 3.0
#: probability that repeats fail to show the effect (type II error)
_MISSED = 0.1
_MOST_REPEATS = 20


def next_against_chance(before: ModelComparison) -> list[NextStep]:
    """Readings that would show whether an effect that improves the fit insignificantly is real."""
    steps: list[NextStep] = []
    for score in near_chance(before.screening):
        steps += _elsewhere(before, score)
        repeats = _repeats(before, score)
        if repeats:
            steps.append(Repeats(repeats, score.effect, score.z * math.sqrt(repeats)))
    return steps


def _elsewhere(before: ModelComparison, score: Score) -> list[FurtherPoint]:
    """Operating points beyond the table's ends at which an effect changes most."""
    problem = before.fit.problem
    points = _other_points(problem)
    if not points:
        return []
    tried = alone(before, before.linearisation.candidates[score.candidate], from_null=True)
    if tried is None:
        return []
    without, with_it = _at(before.fit, points), _at(tried.fit, points)
    deviation = (with_it - without) / problem.noise.channels[0].sigma_at(without)
    output, units = problem.measurements.outputs[0], variable_units(problem.measurements)
    (name,) = problem.measurements.variables
    middle = float(np.mean([record.condition[name] for record in problem.records]))
    steps = []
    for side in (1.0, -1.0):  # beyond the upper end, and below the lower one
        chosen = [k for k, point in enumerate(points) if side * (point[name] - middle) > 0.0]
        index = max(chosen, key=lambda k: abs(deviation[k]), default=None)
        if index is not None and abs(deviation[index]) > _SEEN:
            change = float(with_it[index] / without[index] - 1.0)
            title = problem.measurements.titles.get(output, output)
            point = short_condition(points[index], units)
            steps.append(FurtherPoint(title, point, score.effect, change, abs(float(deviation[index]))))
    return steps


def _other_points(problem: Problem) -> list[dict[str, float]]:
    """Operating points of the family's standard record next to those of the table, and not in it.

    None for a table over several variables, or one whose rows have unknowns of their own.
    """
    standard = problem.model.family.standard_record
    names = problem.measurements.variables
    if standard is None or len(names) != 1 or any(problem.local):
        return []
    (name,) = names
    values = [record.condition[name] for record in problem.records]
    low, high = min(values), max(values)
    room = (high - low) / 3.0
    every = sorted({float(changed[name]) for _, changed in standard.switches if name in changed})
    return [{name: point} for point in every if low - room <= point < low or high < point <= high + room]


def _at(fit: FitResult, points: Sequence[Mapping[str, float]]) -> Floats:
    """(points) the first channel as predicted by a fitted model at other operating points."""
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
    """Number of readings of each row at which an effect of this size is significant; 0 if out of reach."""
    from scipy.special import ndtri

    channel = before.fit.problem.noise.channels[0]
    rows = len(before.fit.problem.records)
    effects, tests = len(before.screening.scores), len(before.adequacy.tests)
    if not channel.degrees:
        return 0
    for count in range(2, _MOST_REPEATS + 1):
        degrees = channel.degrees + rows * (count - 1)
        needed = significant_size(degrees, effects, tests) - float(ndtri(_MISSED))
        if score.z * math.sqrt(count) > needed:
            return count
    return 0


def next_rows(before: ModelComparison) -> list[NextStep]:
    """Rows that would give more information about any effect."""
    measurements = before.fit.problem.measurements
    units = variable_units(measurements)
    steps: list[NextStep] = []
    conditions = [record.condition for record in measurements.records]
    for name in dict.fromkeys(name for condition in conditions for name in condition):
        points = sorted({condition[name] for condition in conditions if name in condition})
        if len(points) <= 2:
            steps.append(MoreValues(name, tuple(points), units[name]))
    if any(channel.guessed for channel in before.fit.problem.noise.channels):
        steps.append(RepeatedConditions())
    return steps
