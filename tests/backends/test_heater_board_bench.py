"""The simulated heater board against independently written equations solved by SciPy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rigctl.backends.simulated.bench import SimulatedBench
from rigctl.rig import Rig, load_rig

MakeBench = Callable[..., SimulatedBench]
Vector = NDArray[np.float64]

ROOM = 296.15
SIGMA = 5.670374419e-8
#: s, actuator, share of full power
SWITCHES = (
    (0.0, "heater_1", 0.3),
    (200.0, "heater_2", 0.8),
    (431.7, "heater_1", 1.0),
    (700.0, "heater_2", 0.0),
)
END, RATE = 1200.0, 0.5


@pytest.fixture(scope="module")
def board() -> Rig:
    return load_rig(Path(__file__).parents[2] / "rigs" / "heater-board.yaml")


def recorded(bench: SimulatedBench) -> Vector:
    """(samples, 2) in K, at `RATE` from 0 to `END`."""
    bench.start(RATE)
    rows: list[tuple[float, ...]] = []
    waiting = list(SWITCHES)
    while len(rows) <= END * RATE:
        while waiting and waiting[0][0] <= len(rows) / RATE:
            when, actuator, value = waiting.pop(0)
            bench.clock.sleep_until(when)
            bench.command(actuator, value).wait()
        sample = bench.next_sample(10.0)
        assert sample is not None
        rows.append(sample.values)
    return np.array(rows)


def solved(rates: Callable[[Vector, float, float], Sequence[float]], start: Sequence[float]) -> Vector:
    """The same by SciPy, from switch to switch: `rates` of (T1, T2, ...) at two powers in W."""
    times = np.arange(END * RATE + 1) / RATE
    power = {"heater_1": 0.0, "heater_2": 0.0}
    found = np.empty((times.size, 2))
    state = np.array(start)
    ends = [when for when, _, _ in SWITCHES[1:]] + [END]
    for (begin, actuator, value), end in zip(SWITCHES, ends, strict=True):
        power[actuator] = value * 1.0
        inside = (times >= begin) & (times < end)
        one, two = power["heater_1"], power["heater_2"]
        solution = solve_ivp(
            lambda t, y, one=one, two=two: rates(y, one, two),
            (begin, end),
            state,
            method="Radau",
            rtol=1e-9,
            atol=1e-9,
            t_eval=np.append(times[inside], end),
        )
        found[inside] = solution.y[:2, :-1].T
        state = solution.y[:, -1]
    found[-1] = state[:2]
    return found


def linear(y: Vector, one: float, two: float) -> list[float]:
    return [(one - 0.016 * (y[0] - ROOM)) / 2.0, (two - 0.016 * (y[1] - ROOM)) / 2.0]


def coupled_and_radiating(y: Vector, one: float, two: float) -> list[float]:
    to_room = [9e-4 * SIGMA * (y[i] ** 4 - ROOM**4) for i in (0, 1)]
    across = 2e-3 * (y[1] - y[0]) + 2e-4 * SIGMA * (y[1] ** 4 - y[0] ** 4)
    base = linear(y, one, two)
    return [base[0] + (across - to_room[0]) / 2.0, base[1] + (-across - to_room[1]) / 2.0]


def test_the_board_follows_its_heat_balance(make_bench: MakeBench, board: Rig) -> None:
    found = recorded(make_bench(on=board, plant=None))
    assert found == pytest.approx(solved(linear, [ROOM, ROOM]), abs=2e-3)
    final = ROOM + 1.0 / 0.016 * (1.0 - 0.7 * math.exp(-(END - 431.7) / 125.0))
    assert found[-1, 0] == pytest.approx(final - 0.3 / 0.016 * math.exp(-END / 125.0), abs=2e-3)


def test_hidden_effects_change_the_board_as_their_equations_say(make_bench: MakeBench, board: Rig) -> None:
    bench = make_bench(on=board, plant=None, effects=["radiation", "heater_coupling"])
    assert recorded(bench) == pytest.approx(solved(coupled_and_radiating, [ROOM, ROOM]), abs=2e-3)


def test_full_power_stays_below_the_interlock_limits(board: Rig) -> None:
    hottest = ROOM + 1.0 / 0.016
    limits = {limit.action: limit.threshold for limit in board.limits.values() if not limit.of_rate}
    noise = 6 * 0.1 + board.channels["temperature_1"].resolution
    assert hottest + noise < limits["warn"] < limits["stop"] == pytest.approx(373.15)


def test_a_disconnected_thermometer_reads_an_impossible_value(board: Rig) -> None:
    for channel in board.channels.values():
        assert not channel.possible(channel.value_from_raw(channel.raw.low))
