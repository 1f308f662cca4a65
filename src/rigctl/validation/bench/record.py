# mypy: disable-error-code="no-untyped-call"
"""One record of the separate bench: a schedule of valve commands, sampled on a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.validation.bench import equations
from rigctl.validation.bench.parameters import Bench, Switching
from rigctl.validation.bench.rosenbrock import integrate

#: the standard record: wait, extend, hold closed, retract — (command, seconds)
STANDARD = ((0.0, 0.2), (1.0, 1.05), (0.0, 1.0), (-1.0, 1.5))
RATE = 100.0  # Hz
FIRST_STEP = 1e-5  # s, after every switch
TOLERANCE = 1e-7


@dataclass(frozen=True)
class Condition:
    """The operating point of a record; SI, pressures gauge."""

    oil: float  # K
    setting: float  # Pa, what the relief valve really stands at
    ambient: float = 295.15  # K
    heater: float = 0.0  # W
    trapped: float = 0.9  # rod-side pressure at the start, as a share of the setting


@dataclass(frozen=True)
class Trace:
    """A record without noise: `states` has one row per sample, `command` what the valve was told."""

    time: NDArray[np.float64]
    command: NDArray[np.float64]
    states: NDArray[np.float64]


class BenchFailure(ArithmeticError):
    """The separate bench could not be integrated: its secrets are not physical together."""


def simulate_record(
    bench: Bench,
    condition: Condition,
    *,
    switching: Switching | None = None,
    schedule: Sequence[tuple[float, float]] = STANDARD,
    rng: np.random.Generator | None = None,
) -> Trace:
    """Integrate one record; switches happen late as `switching` says, samples are not moved.

    Raises
    ------
    BenchFailure
        the step size fell below what can be represented.
    """
    late = delayed(schedule, switching or Switching(), condition, rng)
    edges = np.cumsum([0.0, *(duration for _, duration in schedule)])
    time = np.arange(round(float(edges[-1]) * RATE) + 1) / RATE
    command = np.array([value for value, _ in schedule])[
        np.clip(np.searchsorted(edges, time + 1e-9, side="right") - 1, 0, len(schedule) - 1)
    ]
    state = initial_state(bench, condition)
    states = np.empty((time.size, equations.STATES))
    states[0] = state
    scale = np.array(equations.SCALE)
    now, step, valve = 0.0, FIRST_STEP, late[0][1]
    pending = list(late[1:])
    for i in range(1, time.size):
        while pending and pending[0][0] < time[i] - 1e-12:
            when, value = pending.pop(0)
            _advance(state, when - now, step, valve, condition, bench, scale)
            now, step, valve = max(now, when), FIRST_STEP, value
        step = _advance(state, time[i] - now, step, valve, condition, bench, scale)
        now = time[i]
        states[i] = state
    return Trace(time, command, states)


def delayed(
    schedule: Sequence[tuple[float, float]],
    switching: Switching,
    condition: Condition,
    rng: np.random.Generator | None,
) -> list[tuple[float, float]]:
    """When the valve really switches: (time, command), each opening and closing with its own delay."""
    warm = switching.delay_per_kelvin * (condition.oil - equations.DRIFT_ORIGIN)
    told, when, switches = 0.0, 0.0, []
    for value, duration in schedule:
        delay = (switching.open_delay + warm if value else switching.close_delay) if value != told else 0.0
        if switching.jitter and value != told and rng is not None:
            delay += switching.jitter * rng.standard_normal()
        switches.append((max(0.0, when + max(0.0, delay)), value))
        told, when = value, when + duration
    return sorted(switches, key=lambda switch: switch[0])


def initial_state(bench: Bench, condition: Condition) -> NDArray[np.float64]:
    """After a retract: the piston leans on its end stop, cap side at tank, rod side trapped near supply."""
    state = np.zeros(equations.STATES)
    state[[equations.T_OIL, equations.T_LINE, equations.T_PROBE]] = condition.oil
    state[equations.PS] = state[equations.P_PROBE] = condition.setting
    state[equations.PB] = condition.trapped * condition.setting
    state[equations.X] = -bench.area_b * state[equations.PB] / bench.stop_stiffness
    return state


def _advance(
    state: NDArray[np.float64],
    duration: float,
    step: float,
    valve: float,
    condition: Condition,
    bench: Bench,
    scale: NDArray[np.float64],
) -> float:
    if duration <= 1e-12:
        return step
    inputs = np.array([valve, condition.setting, condition.heater, condition.ambient])
    last = float(integrate(equations.rhs, state, duration, step, inputs, bench, scale, TOLERANCE))
    if last < 0.0:
        raise BenchFailure(f"step size underflow at {condition}")
    return last
