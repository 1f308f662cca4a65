"""Unknown switch times and piecewise linear inputs, compared with independent solutions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from engine_systems import lag_builder, lag_record, plain_function
from rigctl.engine.compile import CompiledSystem, compile_system
from rigctl.engine.excitation import Ramps
from rigctl.engine.simulate import simulate
from rigctl.engine.system import System
from rigctl.engine.tolerance import TIGHT
from rigctl.errors import RigctlError

Floats = NDArray[np.float64]
GAIN, LAG, DECAY, SLOWNESS, W0 = 2.0, 0.3, 0.8, 0.3, 1.0


@pytest.fixture(scope="module")
def lag() -> CompiledSystem:
    builder, _ = lag_builder()
    return compile_system(builder.build())


@pytest.fixture(scope="module")
def slow() -> CompiledSystem:
    """The lag whose input falls ``slowness·w`` late; w decays."""
    builder, _ = lag_builder()
    w = builder.state("w", "1", scale=1e-2)
    builder.equation("w", -w / builder.constant(DECAY, "s"))
    slowness = builder.parameter("slowness", "s", SLOWNESS)
    metre = builder.constant(1.0, "m")
    builder.delay("u", lambda before, _: slowness * w * before / metre)
    return compile_system(builder.build())


def exact(t: Floats, up: float, down: float, late: float = 0.0) -> Floats:
    """Up without delay; down delayed by `late` times w at the command."""
    down = down + late * math.exp(-down / DECAY)
    x = GAIN * (1.0 - np.exp(-np.clip(t - up, 0.0, down - up) / LAG))
    return np.where(t <= down, x, x * np.exp(-np.clip(t - down, 0.0, None) / LAG))


@pytest.mark.parametrize("late", [0.0, SLOWNESS])
def test_derivatives_by_a_switch_time_are_exact_with_and_without_a_delay(
    lag: CompiledSystem, slow: CompiledSystem, late: float
) -> None:
    changes: dict[str, object] = {"switch_times": [0.0, 0.513, 1.257], "shifts": np.eye(3)[:, 1:]}
    if late:
        changes |= {"initial": [0.0, W0], "parameters": [GAIN, LAG, late]}
    found = simulate(
        slow if late else lag,
        [lag_record(**changes)],
        columns=["gain"],
        initial_columns=["x"],
        shift_columns=["up", "down"],
        tolerance=TIGHT,
    ).require()
    t, step = found.times[0], 1e-6
    for name, expected in {
        "up": exact(t, 0.513 + step, 1.257, late) - exact(t, 0.513 - step, 1.257, late),
        "down": exact(t, 0.513, 1.257 + step, late) - exact(t, 0.513, 1.257 - step, late),
    }.items():
        assert found.sensitivity("x", name)[0] == pytest.approx(expected / (2.0 * step), abs=2e-4)
    assert found.sensitivity("x", "x")[0] == pytest.approx(np.exp(-t / LAG), abs=1e-4)


def test_a_shift_may_move_several_switches_or_none(lag: CompiledSystem) -> None:
    both = lag_record(shifts=[[0.0], [1.0], [1.0]])
    found = simulate(lag, [both, lag_record()], columns=["lag"], shift_columns=["offset"]).require()
    apart = simulate(lag, [lag_record(shifts=np.eye(3)[:, 1:])], shift_columns=["up", "down"]).require()
    total = apart.sensitivity("x", "up")[0] + apart.sensitivity("x", "down")[0]
    assert found.sensitivity("x", "offset")[0] == pytest.approx(total, abs=1e-9)
    assert not found.sensitivity("x", "offset")[1].any()
    assert np.array_equal(*found.outputs)
    assert np.array_equal(*found.sensitivity("x", "lag"))


def two_inputs() -> System:
    """``dx/dt = (gain·u − x·v²)/lag``: one input in steps, one piecewise linear."""
    builder, names = lag_builder()
    v = builder.input("v", "1")
    square = names["x"] * v * v
    builder.equation("x", (names["gain"] * names["u"] - square) / names["lag"])
    builder.output("v_seen", "1", v)
    return builder.build()


def test_a_piecewise_linear_input_agrees_with_scipy() -> None:
    system = two_inputs()
    compiled = compile_system(system)
    generator = np.random.default_rng(4)
    knots = np.cumsum(generator.uniform(0.01, 0.3, 25)) - 0.2
    values = generator.uniform(0.5, 2.0, (25, 1))
    record = lag_record(
        inputs=[[0.0, 9.0], [1.0, 9.0], [0.0, 9.0]], ramps=Ramps(np.array([1]), knots, values)
    )
    found = simulate(compiled, [record], columns=["gain", "lag"], tolerance=TIGHT).require()
    f = plain_function(system)

    def solved(gain: float, lag: float) -> Floats:
        t, y, got = 0.0, np.zeros(1), [0.0]
        stops = np.unique([*record.times, *knots[knots > 0.0], *record.switch_times])
        seen = {0.0: 0.0}
        for end in stops[stops > 0.0]:
            u = record.inputs[np.searchsorted(record.switch_times, t, side="right") - 1, 0]

            def rate(at: float, y: Floats, u: float = u) -> list[float]:
                return f(y, np.array([u, np.interp(at, knots, values[:, 0])]), np.array([gain, lag]))

            y = solve_ivp(rate, (t, end), y, rtol=1e-10, atol=1e-12).y[:, -1]
            t = float(end)
            seen[t] = y[0]
        got = [seen[float(t)] for t in record.times]
        return np.array(got)

    assert found.output("x")[0] == pytest.approx(solved(GAIN, LAG), abs=2e-6)
    assert found.output("v_seen")[0] == pytest.approx(np.interp(record.times, knots, values[:, 0]), abs=1e-12)
    step = 1e-5
    slope = (solved(GAIN, LAG + step) - solved(GAIN, LAG - step)) / (2.0 * step)
    assert found.sensitivity("x", "lag")[0] == pytest.approx(slope, abs=1e-4)


def test_knots_of_an_input_do_not_restart_the_integration() -> None:
    compiled = compile_system(two_inputs())
    steps = [[0.0, 1.0], [1.0, 1.0], [0.0, 1.0]]
    knots = np.arange(61) / 20.0
    plain = simulate(compiled, [lag_record(inputs=steps)]).require()
    for value in (1.0 + 0.0 * knots, 1.0 + 0.3 * knots):
        ramps = Ramps(np.array([1]), knots, value[:, None])
        found = simulate(compiled, [lag_record(inputs=steps, ramps=ramps)]).require()
        assert found.stats[0].restarts == plain.stats[0].restarts
    constant = simulate(compiled, [lag_record(inputs=steps, ramps=Ramps([1], knots, 0 * knots[:, None] + 1))])
    assert constant.output("x")[0] == pytest.approx(plain.output("x")[0], abs=1e-12)


@pytest.mark.parametrize(
    ("inputs", "knots", "values", "said"),
    [
        ([0], [0.0, 1.0], [[1.0]], "each knot needs a value"),
        ([0], [0.0, 1.0], [[1.0], [math.nan]], "not finite"),
        ([0], [1.0, 1.0], [[1.0], [2.0]], "do not rise"),
        ([0, 0], [0.0], [[1.0, 2.0]], "twice"),
    ],
)
def test_invalid_ramps_are_refused(
    inputs: list[int], knots: list[float], values: list[list[float]], said: str
) -> None:
    with pytest.raises(RigctlError, match=said):
        Ramps(np.array(inputs), np.array(knots), np.array(values))


def test_a_record_that_does_not_match_its_columns_is_refused(lag: CompiledSystem) -> None:
    with pytest.raises(RigctlError, match="quantities that move its switches"):
        simulate(lag, [lag_record(shifts=np.zeros((3, 2)))], shift_columns=["one"])
    with pytest.raises(RigctlError, match="one row of finite derivatives"):
        lag_record(shifts=np.zeros((2, 1)))
    with pytest.raises(RigctlError, match="none of them"):
        simulate(lag, [lag_record(ramps=Ramps(np.array([5]), np.zeros(1), np.zeros((1, 1))))])
