"""What may be varied: recipes of one kind as functions of a few free numbers, built from records so far.

In: the rig with the conditions of the data so far (`Stage`), and their records. Out: `Scheme`s, each a map
from the unit cube to recipes. A bench that moves gets the order of moves of earlier records, and orders that
start or end elsewhere; a bench that is set to levels gets staircases of them, and if they are continuous slow
ramps, and multisines of one of them. Commands of earlier records are known to be possible on the bench, and
imported data have no procedure that could be varied instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.design.recipe import Drive, Recipe, Stage, Step, Verb, rounded
from rigctl.design.refusals import NothingToSet
from rigctl.model.fit.fit import FitResult
from rigctl.model.inputs import InputSource, input_sources
from rigctl.model.measured.groups import first_reading
from rigctl.model.measured.record import MeasuredRecord
from rigctl.rig.actuator import Actuator
from rigctl.rig.rig import Rig
from rigctl.steps.waveform.checks import SHORTEST
from rigctl.units import parse_unit

Floats = NDArray[np.float64]

#: range of a step's duration, as multiples of the shortest and of the longest one so far
_SHORTER, _LONGER = 0.5, 2.0
#: times are rounded to this share of the shortest step
_ROUNDING = 0.05
#: number of levels of a staircase
_LEVELS = 4
#: number of steps of a ramp, in each direction
_RAMP = 6
#: most lines of a multisine, commands per period of its highest line, and samples at least
_LINES, _COMMANDS, _SAMPLES = 5, 8, 4
#: share of the distance to the ends of a level's range that a multisine uses: between the points at which its
#: peaks are sought it may be higher by less
_WITHIN = 0.99
#: resolution of a level's range, and of a time's digits: what is written is what is simulated
_PARTS = 100.0
#: possible sequences of moves in a record, for benches that have these moves
_MOVES: tuple[tuple[Verb, ...], ...] = (
    ("wait", "extend", "wait", "extend", "wait", "retract"),
    ("wait", "extend", "wait", "retract", "wait", "extend", "wait"),
)


@dataclass(frozen=True)
class Free:
    """A number that may be varied.

    Attributes
    ----------
    low, high: SI.
    unit, step: it is written as a whole number of steps in this unit.
    """

    name: str
    low: float
    high: float
    unit: str
    step: float

    def at(self, share: float) -> float:
        """The value, SI, at a fraction of the range from `low` to `high`, rounded as it would be written."""
        return min(
            max(rounded(self.low + share * (self.high - self.low), self.unit, self.step), self.low), self.high
        )


@dataclass(frozen=True)
class Scheme:
    """Recipes of one kind.

    Attributes
    ----------
    name: for display.
    free: the numbers that are varied.
    build: makes a recipe from the free numbers, SI.
    """

    name: str
    free: tuple[Free, ...]
    build: Callable[[Mapping[str, float]], Recipe]

    def recipe(self, point: Sequence[float]) -> Recipe:
        """The recipe at a point of the unit cube."""
        return self.build({one.name: one.at(float(x)) for one, x in zip(self.free, point, strict=True)})


def stage_of(fit: FitResult, rig: Rig) -> Stage:
    """The conditions for new records, as in the data so far."""
    problem = fit.problem
    model, measurements = problem.model, problem.measurements
    fixed_inputs = {name: value for name, value in model.values.items() if name in measurements.inputs}
    sources = input_sources(model.family, rig, fixed_inputs)
    standing = {
        name: float(np.median([np.median(record.input_course(k)) for record in measurements.records]))
        for k, name in enumerate(measurements.inputs)
    }
    first = measurements.records[fit.fitted[0]]
    readings = {
        name: first_reading(first, k)
        for k, name in enumerate(measurements.outputs)
        if math.isfinite(first_reading(first, k))
    }
    return Stage(rig, sources, standing, readings)


def schemes_of(stage: Stage, records: Sequence[MeasuredRecord]) -> tuple[Scheme, ...]:
    """The kinds of records that the rig can make.

    Raises
    ------
    NothingToSet
        no actuator that the model knows sets the conditions of a record.
    """
    moving = any(source.actuators for source in _moves(stage))
    schemes = tuple(_move_schemes(stage, records) if moving else _level_schemes(stage, records))
    if not schemes:
        raise NothingToSet(
            f"no condition of the rig '{stage.rig.name}' can be set: it has no actuator that the model knows",
            hint="Name sensors that it could have in its rig file, under 'could_have:'",
        )
    return schemes


def _moves(stage: Stage) -> list[InputSource]:
    roles = stage.rig.roles
    names = {role.actuator for role in (roles.extend, roles.retract) if role is not None}
    return [one for one in stage.sources if any(name in names for name, _ in one.actuators)]


# --- benches that move


def _move_schemes(stage: Stage, records: Sequence[MeasuredRecord]) -> Iterator[Scheme]:
    # Orders of moves that this bench has made, then others that consist of the same moves: the user's
    # procedures show what the bench can do.
    steps_by_order = {
        tuple(step.verb for step in steps): steps for steps in map(_moves_taken(stage), records) if steps
    }
    if not steps_by_order:
        return
    lengths = _lengths([step for steps in steps_by_order.values() for step in steps])
    rate = max(_rate(record) for record in records)
    verbs = {verb for order in steps_by_order for verb in order}
    others = [order for order in _MOVES if set(order) <= verbs and order not in steps_by_order]
    for order in (*steps_by_order, *others):
        yield _move_scheme(stage, order, lengths, rate)


def _move_scheme(
    stage: Stage, order: Sequence[Verb], lengths: Mapping[Verb, tuple[float, float]], rate: float
) -> Scheme:
    times = [_time(f"{verb} {k + 1}", *lengths[verb]) for k, verb in enumerate(order)]

    def build(values: Mapping[str, float]) -> Recipe:
        steps = tuple(Step(verb, values[f"{verb} {k + 1}"]) for k, verb in enumerate(order))
        return Recipe(steps, rate, values.get("temperature"), values.get("pressure"))

    return Scheme(", ".join(order), (*_operating_point(stage), *times), build)


def _moves_taken(stage: Stage) -> Callable[[MeasuredRecord], list[Step]]:
    """The commands of a record, as steps."""
    names = [source.input for source in stage.sources]
    (move,) = _moves(stage)[:1]
    index = names.index(move.input)

    def steps_of(record: MeasuredRecord) -> list[Step]:
        ends = [*record.switch_times[1:].tolist(), float(record.times[-1])]
        moves: list[Step] = []
        for begin, end, row in zip(record.switch_times.tolist(), ends, record.inputs, strict=True):
            value = float(row[index])
            verb: Verb = "extend" if value > 0.0 else "retract" if value < 0.0 else "wait"
            length = end - max(begin, 0.0)
            if moves and moves[-1].verb == verb:
                moves[-1] = replace(moves[-1], seconds=moves[-1].seconds + length)
            elif length > 0.0:
                moves.append(Step(verb, length))
        return moves

    return steps_of


def _lengths(steps: Sequence[Step]) -> dict[Verb, tuple[float, float]]:
    """The shortest and the longest duration of each verb."""
    lengths: dict[Verb, tuple[float, float]] = {}
    for step in steps:
        low, high = lengths.get(step.verb, (math.inf, 0.0))
        lengths[step.verb] = (min(low, _SHORTER * step.seconds), max(high, _LONGER * step.seconds))
    return lengths


def _time(name: str, low: float, high: float) -> Free:
    step = 10.0 ** math.floor(math.log10(max(low, 1e-3) * _ROUNDING * 10.0))
    return Free(name, max(low, step), high, "s", step)


# --- benches that are set to levels


def _level_schemes(stage: Stage, records: Sequence[MeasuredRecord]) -> Iterator[Scheme]:
    levels = _levels(stage)
    point = _operating_point(stage)
    if not levels and not point:
        return
    longest = max(float(record.times[-1] - record.times[0]) for record in records)
    # Times follow from the records so far: a hold of a staircase is up to the longest one in them.
    dwell = max(_dwells(records), default=longest)
    rate = max(_rate(record) for record in records)
    time = _time("dwell", _SHORTER * dwell / _LEVELS, dwell)
    yield _staircase(stage, levels, point, time, rate, rest=dwell if levels else 0.0)
    continuous = [one for one in levels if stage.rig.actuators[one.name].kind != "switch"]
    if continuous:
        dwell_of_ramp = _LEVELS * dwell / (2.0 * _RAMP)
        time = _time("dwell", _SHORTER * dwell_of_ramp / _LEVELS, dwell_of_ramp)
        yield _ramp(stage, continuous, point, time, rate, rest=dwell)
    for one in continuous:
        period = _period(stage.rig.actuators[one.name], rate, _LEVELS * dwell)
        if period is not None:
            others = [level for level in levels if level is not one]
            yield _multisine(stage.rig, one, others, point, period, rate, rest=dwell)


def _staircase(
    stage: Stage, levels: Sequence[Free], point: Sequence[Free], time: Free, rate: float, rest: float
) -> Scheme:
    free = [replace(one, name=f"{one.name} {k}") for k in range(_LEVELS + 1) for one in levels]

    def build(values: Mapping[str, float]) -> Recipe:
        stairs = [{one.name: values[f"{one.name} {k}"] for one in levels} for k in range(_LEVELS + 1)]
        verb: Verb = "set" if levels else "wait"
        steps = tuple(Step(verb, values["dwell"], stair) for stair in stairs[1:])
        point = values.get("temperature"), values.get("pressure")
        return Recipe(steps, rate, *point, before=stairs[0], rest=rest)

    return Scheme("staircase", (*point, *free, time), build)


def _ramp(
    stage: Stage, levels: Sequence[Free], point: Sequence[Free], time: Free, rate: float, rest: float
) -> Scheme:
    """A scheme from one level to another and back, in small equal steps; switched levels stay at their
    safe values."""
    free = [replace(one, name=f"{one.name} {end}") for end in ("begin", "top", "end") for one in levels]
    along = np.linspace(0.0, 1.0, _RAMP + 1)[1:]

    def build(values: Mapping[str, float]) -> Recipe:
        ends = [{one.name: values[f"{one.name} {end}"] for one in levels} for end in ("begin", "top", "end")]
        stairs = [
            {one.name: _on_the_way(one, begin[one.name], to[one.name], float(share)) for one in levels}
            for begin, to in pairwise(ends)
            for share in along
        ]
        steps = tuple(Step("set", values["dwell"], stair) for stair in stairs)
        before = values.get("temperature"), values.get("pressure")
        return Recipe(steps, rate, *before, before=ends[0], rest=rest)

    return Scheme("ramp", (*point, *free, time), build)


def _multisine(
    rig: Rig,
    driven: Free,
    others: Sequence[Free],
    point: Sequence[Free],
    period: Free,
    rate: float,
    rest: float,
) -> Scheme:
    """A scheme of one level along a multisine about a mean, while the others hold.

    A staircase tells gains and slow times apart; a band of frequencies tells lags, delays and resonances
    apart. The search chooses the band: its lowest frequency is 1/period, and its highest a few times that.
    """
    ends = [replace(driven, name=f"{driven.name} {end}") for end in ("least", "most")]
    lines = Free("lines", 2.0, float(_LINES), "1", 1.0)

    def build(values: Mapping[str, float]) -> Recipe:
        low, high = sorted(values[one.name] for one in ends)
        drive = Drive(
            driven.name,
            (low + high) / 2.0,
            _WITHIN * max(high - low, parse_unit(driven.unit).factor * driven.step) / 2.0,
            values["period"],
            round(values["lines"]),
            _command_rate(rig.actuators[driven.name], values["lines"] / values["period"]),
        )
        before = {one.name: values[one.name] for one in others} | {driven.name: drive.mean}
        steps = (Step("waveform", drive.period, drive=drive),)
        return Recipe(steps, rate, values.get("temperature"), values.get("pressure"), before, rest)

    return Scheme(f"multisine of {driven.name}", (*point, *others, *ends, period, lines), build)


def _period(actuator: Actuator, rate: float, longest: float) -> Free | None:
    """How long a multisine may take; None if its highest line is too fast for the actuator or the record."""
    apart = max(_SAMPLES / rate, _COMMANDS * max(actuator.min_interval, SHORTEST))
    shortest = _LINES * apart
    return _time("period", max(shortest, longest / _COMMANDS), longest) if shortest < longest else None


def _command_rate(actuator: Actuator, highest: float) -> float:
    """Commands per second for a multisine up to a frequency, Hz, in the digits in which it is written."""
    return float(f"{min(_COMMANDS * highest, 1.0 / max(actuator.min_interval, SHORTEST)):.3g}")


def _on_the_way(level: Free, begin: float, to: float, share: float) -> float:
    """An intermediate level of a ramp, rounded as it would be written."""
    return min(max(rounded(begin + share * (to - begin), level.unit, level.step), level.low), level.high)


def _levels(stage: Stage) -> list[Free]:
    """The levels that a procedure can set during a record; levels with a role are set before it."""
    roles = stage.rig.roles
    before = {role.actuator for role in (roles.heat, roles.set_pressure) if role is not None}
    levels = []
    for name in dict.fromkeys(name for source in stage.sources for name, _ in source.actuators):
        actuator = stage.rig.actuators[name]
        if name in before or actuator.kind == "directional_valve":
            continue
        low, high = (0.0, 1.0) if actuator.kind == "switch" else (actuator.low, actuator.high)
        if low is None or high is None or not high > low:
            continue
        discrete = actuator.kind == "switch"
        unit = actuator.display_unit
        width = (float(high) - float(low)) / parse_unit(unit).factor
        levels.append(Free(name, float(low), float(high), unit, 1.0 if discrete else tenth(width / _PARTS)))
    return levels


def _dwells(records: Sequence[MeasuredRecord]) -> list[float]:
    """The longest time for which each record's commands held."""
    return [
        float(np.max(np.diff([*record.switch_times.clip(min=0.0), record.times[-1]]))) for record in records
    ]


# --- the operating point


def _operating_point(stage: Stage) -> list[Free]:
    """What is established before a record: a temperature, a pressure."""
    rig, inputs = stage.rig, {name for source in stage.sources for name, _ in source.actuators}
    variables = []
    # Only what the rig file gives a role can be established before a record; its range is that in which no
    # limit trips.
    heat, pressure = rig.roles.heat, rig.roles.set_pressure
    if heat is not None and heat.channel in stage.readings:
        low, high = allowed(rig, heat.channel, _coldest(rig), math.inf)
        if math.isfinite(high) and high > low:
            variables.append(Free("temperature", low, high, rig.channels[heat.channel].unit, 1.0))
    if pressure is not None and pressure.actuator in inputs:
        actuator = rig.actuators[pressure.actuator]
        if actuator.low is not None and actuator.high is not None:
            low, high = allowed(rig, pressure.channel, float(actuator.low), float(actuator.high))
            width = (high - low) / parse_unit(actuator.display_unit).factor
            variables.append(Free("pressure", low, high, actuator.display_unit, tenth(width / _PARTS)))
    return variables


def _coldest(rig: Rig) -> float:
    """The temperature to which the oil cools by itself in an acceptable time."""
    room = float(rig.constants.get("ambient_temperature", rig.simulation.ambient_temperature))
    start = rig.simulation.initial.get(rig.roles.heat.channel) if rig.roles.heat is not None else None
    return room if start is None else min(room, float(start))


def allowed(rig: Rig, channel: str, low: float, high: float) -> tuple[float, float]:
    """The part of a range in which no limit of the rig trips, and that the channel can measure."""
    described = rig.channels[channel]
    if described.range is not None:
        low, high = max(low, float(described.range[0])), min(high, float(described.range[1]))
    for limit in rig.limits.values():
        if limit.channel != channel or not limit.of_value:
            continue
        low, high = (
            (low, min(high, limit.threshold)) if limit.bound == "above" else (max(low, limit.threshold), high)
        )
    return low, high


def tenth(width: float) -> float:
    """The largest power of ten, or half of one, that does not exceed a width."""
    power = 10.0 ** math.floor(math.log10(width))
    return 5.0 * power if width >= 5.0 * power else power


def _rate(record: MeasuredRecord) -> float:
    """Samples per second."""
    step = float(np.median(np.diff(record.times)))
    return float(f"{1.0 / step:.3g}")
