"""A bench stepped sample by sample is the record that `simulate` computes."""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np
import pytest

from engine_systems import lag_builder, lag_record
from rigctl.engine.compile import CompiledSystem, compile_system
from rigctl.engine.simulate import simulate
from rigctl.engine.stepper import Stepper
from rigctl.engine.tolerance import TIGHT
from rigctl.errors import ExitCode, RigctlError


def test_stepping_a_record_is_bit_identical_to_simulating_it(
    cylinder: ModuleType, cylinder_compiled: CompiledSystem
) -> None:
    record = cylinder.campaign()[5]
    whole = simulate(cylinder_compiled, [record])
    stepper = Stepper(cylinder_compiled, record.initial, record.parameters, record.inputs[0])
    assert np.array_equal(stepper.outputs(), whole.outputs[0][0])
    for k, t in enumerate(record.times[1:], start=1):
        phase = int(np.searchsorted(record.switch_times, t, side="left")) - 1
        stepper.advance(float(t), record.inputs[phase])
        assert np.array_equal(stepper.state, whole.states[0][k])
        assert np.array_equal(stepper.outputs(), whole.outputs[0][k])
    assert stepper.steps == whole.stats[0].steps


def test_smooth_phases_take_one_step_a_call(cylinder: ModuleType, cylinder_compiled: CompiledSystem) -> None:
    record = cylinder.campaign()[0]
    stepper = Stepper(cylinder_compiled, record.initial, record.parameters, [0.0, *record.inputs[0][1:]])
    for k in range(1, 101):
        stepper.advance(k / 10.0)
    settled = stepper.steps
    for k in range(101, 1101):
        stepper.advance(k / 10.0)
    assert stepper.steps - settled == 1000


def test_switches_between_samples_act_at_their_exact_time(lag: CompiledSystem) -> None:
    stepper = Stepper(lag, [0.0], [2.0, 0.3], [0.0], tolerance=TIGHT)
    stepper.switch_input("u", 0.0, at=1.003)
    stepper.switch_input("u", 1.0, at=0.317)
    stepper.advance(0.3)
    assert stepper.outputs()[0] == 0.0
    stepper.advance(1.0)
    assert stepper.outputs()[0] == pytest.approx(2.0 * (1.0 - math.exp(-0.683 / 0.3)), abs=1e-6)
    stepper.advance(1.5)
    top = 2.0 * (1.0 - math.exp(-0.686 / 0.3))
    assert stepper.outputs()[0] == pytest.approx(top * math.exp(-0.497 / 0.3), abs=1e-6)
    assert stepper.time == 1.5


def test_simultaneous_commands_act_in_the_order_given(lag: CompiledSystem) -> None:
    stepper = Stepper(lag, [0.0], [2.0, 0.3], [0.0])
    for value in (5.0, 3.0, 4.0):
        stepper.switch_input("u", value, at=1.0)
    stepper.advance(1.0)
    assert stepper.acting_inputs.tolist() == [4.0]
    stepper.switch_input("u", 7.0)
    stepper.advance(1.0)
    assert stepper.acting_inputs.tolist() == [7.0]


def test_a_delay_is_honoured_across_calls() -> None:
    builder, _ = lag_builder()
    rise = builder.parameter("rise", "s", 0.25)
    builder.delay("u", lambda before, after: rise)
    compiled = compile_system(builder.build())
    stepper = Stepper(compiled, [0.0], [2.0, 0.3, 0.25], [0.0], tolerance=TIGHT)
    stepper.advance(0.1, [1.0])
    assert stepper.acting_inputs.tolist() == [0.0]
    stepper.advance(0.2)
    stepper.advance(0.4)
    assert stepper.acting_inputs.tolist() == [1.0]
    assert stepper.outputs()[0] == pytest.approx(2.0 * (1.0 - math.exp(-0.15 / 0.3)), abs=1e-6)
    for k in range(200):
        stepper.switch_input("u", float(k % 2), at=0.5 + 1e-3 * k)
    with pytest.raises(RigctlError, match="too many commands wait for their delay"):
        stepper.advance(1.0)


def test_repeated_runs_of_5000_calls_are_bit_identical(lag: CompiledSystem) -> None:
    def run() -> bytes:
        stepper = Stepper(lag, [0.0], [2.0, 0.3], [0.0])
        seen = np.empty(5_000)
        for k in range(5_000):
            stepper.advance((k + 1) / 100.0, [float(k // 300 % 2)])
            seen[k] = stepper.outputs()[0]
        return seen.tobytes()

    assert run() == run()


def test_mistakes_are_refused_with_their_reason(lag: CompiledSystem) -> None:
    stepper = Stepper(lag, [0.0], [2.0, 0.3], [0.0], time=1.0)
    with pytest.raises(RigctlError, match=r"back in time, got '0.5 s'; expected 1 s or later"):
        stepper.advance(0.5)
    with pytest.raises(RigctlError, match="back in time"):
        stepper.advance(math.nan)
    with pytest.raises(RigctlError, match="not a finite number"):
        stepper.advance(2.0, [math.nan])
    with pytest.raises(RigctlError, match="unknown input, got 'v'"):
        stepper.switch_input("v", 1.0)
    with pytest.raises(RigctlError, match="in the past"):
        stepper.switch_input("u", 1.0, at=0.9)
    with pytest.raises(RigctlError, match="the input u is not a finite number"):
        stepper.switch_input("u", math.inf)
    with pytest.raises(RigctlError, match="2 initial states; expected 1"):
        Stepper(lag, [0.0, 1.0], [2.0, 0.3], [0.0])
    with pytest.raises(RigctlError, match="one of the parameters is not a finite number"):
        Stepper(lag, [0.0], [2.0, math.nan], [0.0])


def test_equations_without_a_finite_value_end_the_simulation_with_a_reason(lag: CompiledSystem) -> None:
    stepper = Stepper(lag, [0.0], [2.0, 0.0], [1.0])
    with pytest.raises(RigctlError, match="broke down: the derivative of x is not a finite number") as caught:
        stepper.advance(2.0)
    assert caught.value.exit_code is ExitCode.FAILED


def test_stepping_with_switch_commands_is_identical_to_simulating_the_record(lag: CompiledSystem) -> None:
    record = lag_record()
    stepper = Stepper(lag, record.initial, record.parameters, record.inputs[0])
    for moment, inputs in zip(record.switch_times[1:], record.inputs[1:], strict=True):
        stepper.switch_input("u", float(inputs[0]), at=float(moment))
    stepped = [0.0]
    for t in record.times[1:]:
        stepper.advance(float(t))
        stepped.append(float(stepper.outputs()[0]))
    assert stepped == simulate(lag, [record]).outputs[0][:, 0].tolist()
