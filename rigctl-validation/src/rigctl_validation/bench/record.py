# mypy: disable-error-code="no-untyped-call"
"""One record of the separate bench: a schedule of valve commands, sampled on a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl_validation.bench import equations
from rigctl_validation.bench.parameters import BenchParameters, Switching
from rigctl_validation.bench.rosenbrock import follow

#: the standard record: wait, extend, hold closed, retract — (command, seconds)
STANDARD = ((0.0, 0.2), (1.0, 1.05), (0.0, 1.0), (-1.0, 1.5))
RATE = 100.0  # Hz
FIRST_STEP = 1e-5  # s, after every switch
TOLERANCE = 1e-6  # errors stay below 2e-4 of the noise in every sample


@dataclass(frozen=True)
class Condition:
    """The operating point of a record; SI, pressures gauge."""

    oil: float  # K
    setting: float  # Pa, actual setting of the relief valve
    ambient: float = 295.15  # K
    heater: float = 0.0  # W
    trapped: float = 0.9  # rod-side pressure at the start, as a share of the setting


@dataclass(frozen=True)
class Trace:
    """A noise-free record: `states` has one row per sample, `command` the commands of the valve."""

    time: NDArray[np.float64]
    command: NDArray[np.float64]
    states: NDArray[np.float64]


class BenchFailure(ArithmeticError):
    """The separate bench could not be integrated: its hidden effects are not physical together."""


def simulate_record(
    bench: BenchParameters,
    condition: Condition,
    *,
    switching: Switching | None = None,
    schedule: Sequence[tuple[float, float]] = STANDARD,
    rng: np.random.Generator | None = None,
    rate: float = RATE,
) -> Trace:
    """Integrate one record, sampled at `rate` [Hz]; `switching` delays switches, but no sampling times.

    Raises
    ------
    BenchFailure
        the step size fell below what can be represented.
    """
    late = delayed(schedule, switching or Switching(), condition, rng)
    edges = np.cumsum([0.0, *(duration for _, duration in schedule)])
    time = np.arange(round(float(edges[-1]) * rate) + 1) / rate
    command = np.array([value for value, _ in schedule])[
        np.clip(np.searchsorted(edges, time + 1e-9, side="right") - 1, 0, len(schedule) - 1)
    ]
    states = np.empty((time.size, equations.STATES))
    states[0] = initial_state(bench, condition)
    inputs = np.array([0.0, condition.setting, condition.heater, condition.ambient])
    when, commands = (np.array(column) for column in zip(*late, strict=True))
    scale = np.array(equations.SCALE)
    plain = bench.in_floats()
    if not follow(states, time, when, commands, inputs, plain, scale, FIRST_STEP, TOLERANCE):
        raise BenchFailure(f"step size underflow at {condition}")
    return Trace(time, command, states)


def delayed(
    schedule: Sequence[tuple[float, float]],
    switching: Switching,
    condition: Condition,
    rng: np.random.Generator | None,
) -> list[tuple[float, float]]:
    """Actual switches of the valve: (time, command), each opening and closing with its own delay."""
    commanded, when, switches = 0.0, 0.0, []
    for value, duration in schedule:
        delay = switching_delay(switching, condition.oil, value, rng) if value != commanded else 0.0
        switches.append((max(0.0, when + max(0.0, delay)), value))
        commanded, when = value, when + duration
    return sorted(switches, key=lambda switch: switch[0])


def switching_delay(
    switching: Switching, oil: float, command: float, rng: np.random.Generator | None
) -> float:
    """s from the command to the spool's movement; opening is later where the oil is warm."""
    warm = switching.delay_per_kelvin * equations.above_20_celsius(oil, switching.delay_fade)
    delay = switching.open_delay + warm if command else switching.close_delay
    if rng is not None:
        delay += (switching.jitter + switching.jitter_share * delay) * rng.standard_normal()
    return delay


def initial_state(bench: BenchParameters, condition: Condition) -> NDArray[np.float64]:
    """After a retract: the piston leans on its end stop, cap side at tank, rod side trapped near supply."""
    state = np.zeros(equations.STATES)
    room = condition.oil - condition.ambient
    state[[equations.T_OIL, equations.T_PROBE]] = condition.oil
    state[equations.T_LINE] = condition.oil - bench.line_share * room
    state[equations.PS] = state[equations.P_PROBE] = condition.setting
    state[equations.PB] = condition.trapped * condition.setting
    pressed = (bench.area_b * state[equations.PB] + bench.constant_load) / bench.stop_stiffness
    pressed = max(pressed, equations.CONTACT / 2.0)
    state[equations.X] = (equations.CONTACT**2 - 4.0 * pressed**2) / (4.0 * pressed)  # end_stop at rest
    return state
