"""How long each action is expected to take, and where it leaves the bench."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, TypeAlias

from rigctl.planning.bench import ANSWERING, TURNING, TYPING, Bench, State
from rigctl.procedure.actions import Action, Heat, Hold, Measure, Move, Prompt, Set, SetLevel, Wait
from rigctl.procedure.shown import shown_time
from rigctl.units import show


class Basis(IntEnum):
    """What an expected duration rests on; the larger, the less it is worth."""

    TIMED = 0  #: the procedure says how long
    ESTIMATED = 1  #: from the rig's geometry and heat balance
    GUESSED = 2  #: a person is assumed to take so long
    AT_MOST = 3  #: it ends on a condition; this is its timeout


#: what a forecast says a channel will read at most and at least, SI
Extents: TypeAlias = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Forecast:
    """What one action is expected to do."""

    seconds: float
    basis: Basis
    state: State
    reaches: Extents = field(default_factory=dict)
    warning: str | None = None


#: s that a driven level and the valve take besides what is asked of them
_DRIVEN_LEVEL = 1.0
_VALVE = 0.1


def forecast(action: Action, state: State, bench: Bench) -> Forecast:
    """The expected course of an action that starts from `state`."""
    return _FORECASTS[type(action)](action, state, bench)


def _heat(action: Heat, state: State, bench: Bench) -> Forecast:
    """The way to the tolerance, then the settling time; see `rigctl.planning.tank`."""
    reaches = {action.channel: (action.to - action.within, action.to + action.within)}
    tank, start = bench.tank, state.temperature
    if tank is None or start is None:
        there = replace(state, temperature=action.to)
        return Forecast(action.timeout, Basis.AT_MOST, there, reaches)
    low, high = action.to - action.within, action.to + action.within
    heating = start < low
    edge = low if heating else high
    approach = 0.0 if low <= start <= high else tank.time_to(edge, start, state.pressure, heating)
    total = approach + action.settle
    warning = _never(action, state, bench, heating) if math.isinf(approach) else None
    if warning is None and total > action.timeout:
        warning = (
            f"takes about {_rounded(total)} from {_shown(start, action, bench)}, "
            f"but fails after {shown_time(action.timeout)}"
        )
    if warning is not None:
        return Forecast(
            action.timeout, Basis.AT_MOST, replace(state, temperature=action.to), reaches, warning
        )
    reached = edge if approach > 0.0 else start
    settled = tank.after(reached, action.settle, state.pressure, heating=reached < action.to)
    drifted = tank.after(reached, action.settle, state.pressure, heating=False)
    if drifted > high and reached >= action.to:
        warning = f"the pump alone heats the oil past {_shown(high, action, bench)} while it settles"
    role = bench.rig.roles.heat
    own = role.hysteresis if role is not None else None
    off_above = action.to + (0.5 * action.within if own is None else min(own, action.within))
    end = min(settled, max(off_above, drifted))
    return Forecast(total, Basis.ESTIMATED, replace(state, temperature=end), reaches, warning)


def _never(action: Heat, state: State, bench: Bench, heating: bool) -> str:
    limit = bench.tank.limit(state.pressure, heating) if bench.tank is not None else math.nan
    pressure = show(state.pressure, "bar", digits=3)
    what = "with the heater on, the oil gets no hotter" if heating else "the oil cools no further"
    return f"{what} than {_shown(limit, action, bench)} at {pressure}"


def _shown(temperature: float, action: Heat, bench: Bench) -> str:
    return show(temperature, bench.rig.channels[action.channel].unit, digits=3)


def _rounded(seconds: float) -> str:
    return shown_time(float(f"{seconds:.2g}"))


def _set_level(action: SetLevel, state: State, bench: Bench) -> Forecast:
    by_hand = bench.rig.actuators[action.actuator].by == "operator"
    setting = bench.operator_time(TURNING) if by_hand else _DRIVEN_LEVEL
    total = setting + action.settle
    role = bench.rig.roles.set_pressure
    after = bench.pass_time(state, total)
    if role is not None and role.actuator == action.actuator:
        after = replace(after, pressure=action.to)
    reaches = {action.channel: (action.to - action.within, action.to + action.within)}
    basis = Basis.GUESSED if by_hand and not bench.simulated else Basis.ESTIMATED
    return Forecast(total, basis, after, reaches)


def _move(action: Move, state: State, bench: Bench) -> Forecast:
    speed = bench.speed(action.direction, state)
    if action.duration is not None:
        travel = action.direction * (speed or 0.0) * action.duration
        seconds, basis = action.duration, Basis.TIMED
    elif speed is None or speed <= 0.0:
        travel = 0.0
        seconds, basis = action.timeout or 0.0, Basis.AT_MOST
    else:
        travel = _way(action, state, bench)
        seconds = min(abs(travel) / speed + _VALVE, action.timeout or math.inf)
        basis = Basis.ESTIMATED
    stroke = bench.cylinder.stroke if bench.cylinder is not None else math.inf
    position = min(max(state.position + travel, 0.0), stroke)
    after = replace(bench.pass_time(state, seconds), position=position)
    reaches: Extents = {}
    if action.position is not None and speed is not None and 0.0 < position < stroke:
        # an end stop is where a move ends by itself, not a place that the plan asks for
        reaches = {action.position: (position, position)}
    return Forecast(seconds, basis, after, reaches)


def _way(action: Move, state: State, bench: Bench) -> float:
    """Metres to the target; a condition is taken to hold at the end of the stroke."""
    if action.target is not None:
        way = action.target - state.position
        return way if way * action.direction > 0.0 else 0.0
    stroke = bench.cylinder.stroke if bench.cylinder is not None else 0.0
    return stroke - state.position if action.direction > 0 else -state.position


def _hold(action: Hold, state: State, bench: Bench) -> Forecast:
    reaches: Extents = {}
    if action.at is not None:
        reaches = {action.channel: (action.at - action.within, action.at + action.within)}
    return Forecast(action.duration, Basis.TIMED, bench.pass_time(state, action.duration), reaches)


def _wait(action: Wait, state: State, bench: Bench) -> Forecast:
    if action.duration is not None:
        return Forecast(action.duration, Basis.TIMED, bench.pass_time(state, action.duration))
    seconds = action.timeout or 0.0
    return Forecast(seconds, Basis.AT_MOST, bench.pass_time(state, seconds))


def _set(action: Set, state: State, bench: Bench) -> Forecast:
    role = bench.rig.roles.set_pressure
    seconds = action.duration or 0.0
    after = bench.pass_time(state, seconds)
    if role is None or role.actuator not in action.values:
        return Forecast(seconds, Basis.TIMED, after)
    level = action.values[role.actuator]
    return Forecast(seconds, Basis.TIMED, replace(after, pressure=level), {role.channel: (level, level)})


def _prompt(action: Prompt, state: State, bench: Bench) -> Forecast:
    seconds = bench.operator_time(ANSWERING if action.name is None else TYPING)
    basis = Basis.ESTIMATED if bench.simulated else Basis.GUESSED
    return Forecast(seconds, basis, bench.pass_time(state, seconds))


def _measure(action: Measure, state: State, bench: Bench) -> Forecast:
    return Forecast(0.0, Basis.TIMED, state)


_FORECASTS: Mapping[type, Callable[[Any, State, Bench], Forecast]] = {
    Heat: _heat,
    SetLevel: _set_level,
    Move: _move,
    Hold: _hold,
    Wait: _wait,
    Set: _set,
    Prompt: _prompt,
    Measure: _measure,
}
