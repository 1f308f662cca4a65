"""Delayed switches compared with analytical solutions."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from engine_systems import lag_builder, lag_record
from rigctl.engine.compile import CompiledSystem, compile_system
from rigctl.engine.failure import Cause
from rigctl.engine.simulate import simulate
from rigctl.engine.tolerance import TIGHT

Floats = NDArray[np.float64]
GAIN, LAG, DECAY = 2.0, 0.3, 0.8


@pytest.fixture(scope="module")
def delayed() -> CompiledSystem:
    """The lag whose input rises after `rise`, and falls after ``fall + slowness·w``; w decays from w(0)."""
    builder, names = lag_builder()
    w = builder.state("w", "1", scale=1e-2)
    builder.equation("w", -w / builder.constant(DECAY, "s"))
    rise, fall = builder.parameter("rise", "s", 0.0), builder.parameter("fall", "s", 0.0)
    slowness = builder.parameter("slowness", "s", 0.0)
    metre = builder.constant(1.0, "m")
    builder.delay("u", lambda before, after: (rise * after + (fall + slowness * w) * before) / metre)
    assert names["x"].name == "x"
    return compile_system(builder.build())


def record(rise: float = 0.0, fall: float = 0.0, slowness: float = 0.0, **changes: object) -> object:
    fields: dict[str, object] = {
        "initial": [0.0, 1.0],
        "parameters": [GAIN, LAG, rise, fall, slowness],
        **changes,
    }
    return lag_record(**fields)


def exact(t: Floats, rise: float, fall: float, slowness: float, w0: float = 1.0) -> Floats:
    """Commands at 0.5 s and 1.25 s; the delay of the second depends on w at its time."""
    up = 0.5 + rise
    down = 1.25 + fall + slowness * w0 * math.exp(-1.25 / DECAY)
    x = GAIN * (1.0 - np.exp(-np.clip(t - up, 0.0, down - up) / LAG))
    return np.where(t <= down, x, x * np.exp(-np.clip(t - down, 0.0, None) / LAG))


def slope(f: Callable[[float], Floats], at: float, step: float = 1e-6) -> Floats:
    return (f(at + step) - f(at - step)) / (2.0 * step)


def test_delays_and_their_sensitivities_agree_with_the_exact_solution(delayed: CompiledSystem) -> None:
    rise, fall, slowness = 0.1234, 0.0567, 0.3
    result = simulate(
        delayed,
        [record(rise, fall, slowness)],
        columns=["rise", "fall", "slowness"],
        initial_columns=["w"],
        tolerance=TIGHT,
    ).require()
    t = result.times[0]
    assert result.output("x")[0] == pytest.approx(exact(t, rise, fall, slowness), abs=1e-6)
    for column, derivative in {
        "rise": slope(lambda v: exact(t, v, fall, slowness), rise),
        "fall": slope(lambda v: exact(t, rise, v, slowness), fall),
        "slowness": slope(lambda v: exact(t, rise, fall, v), slowness),
        "w": slope(lambda v: exact(t, rise, fall, slowness, v), 1.0),
    }.items():
        assert np.abs(derivative).max() > 0.04
        assert result.sensitivity("x", column)[0] == pytest.approx(derivative, abs=1e-4)


def test_a_zero_delay_is_bit_identical_to_a_plain_switch_and_has_its_derivative(
    lag: CompiledSystem, delayed: CompiledSystem
) -> None:
    plain = simulate(lag, [lag_record()])
    result = simulate(delayed, [record()], columns=["rise", "fall", "gain"], tolerance=TIGHT)
    only_x = simulate(delayed, [record(initial=[0.0, 0.0])])
    assert only_x.stats[0].restarts == plain.stats[0].restarts
    t = result.times[0]
    # one-sided: no command acts before it is given
    forward = (exact(t, 1e-7, 0.0, 0.0) - exact(t, 0.0, 0.0, 0.0)) / 1e-7
    assert result.sensitivity("x", "rise")[0] == pytest.approx(forward, abs=1e-4)
    undelayed_builder, _ = lag_builder()
    w = undelayed_builder.state("w", "1", scale=1e-2)
    undelayed_builder.equation("w", -w / undelayed_builder.constant(DECAY, "s"))
    undelayed = compile_system(undelayed_builder.build())
    bare = simulate(undelayed, [record(parameters=[GAIN, LAG])], tolerance=TIGHT)
    assert np.array_equal(bare.outputs[0], result.outputs[0])


def test_a_negative_delay_acts_at_once_with_zero_sensitivity(delayed: CompiledSystem) -> None:
    result = simulate(delayed, [record(rise=-0.2)], columns=["rise"])
    assert np.array_equal(result.outputs[0], simulate(delayed, [record()]).outputs[0])
    assert not result.sensitivities[0].any()


def test_a_later_command_that_acts_earlier_cancels_the_pending_one(delayed: CompiledSystem) -> None:
    """The valve of a pulse shorter than its opening time does not open."""
    result = simulate(delayed, [record(rise=0.9, fall=0.05)], columns=["rise"])
    assert not result.output("x")[0].any()
    assert not result.sensitivities[0].any()


def test_several_commands_may_be_pending_at_once(delayed: CompiledSystem) -> None:
    pulses = record(
        rise=0.2,
        fall=0.25,
        switch_times=[0.0, 0.5, 0.6, 0.8],
        inputs=[[0.0], [1.0], [0.0], [1.0]],
    )
    x = simulate(delayed, [pulses], tolerance=TIGHT).output("x")[0]
    t = simulate(delayed, [pulses]).times[0]
    # up at 0.7, down at 0.85, up at 1.0
    first = GAIN * (1.0 - math.exp(-0.15 / LAG))
    second = first * math.exp(-0.15 / LAG)
    assert x[t < 0.7].max() == 0.0
    assert x[t == 0.85] == pytest.approx(first, abs=1e-6)
    assert x[t == 1.0] == pytest.approx(second, abs=1e-6)
    assert x[-1] == pytest.approx(GAIN, abs=1e-2)


def test_a_delay_that_is_not_finite_is_a_failure(delayed: CompiledSystem) -> None:
    failure = simulate(delayed, [record(slowness=1e308, initial=[0.0, 1e308])]).failures[0]
    assert failure is not None
    assert failure.cause is Cause.DELAY
    assert failure.time == 0.5
    assert "a delay of u is not a finite number" in str(failure)
