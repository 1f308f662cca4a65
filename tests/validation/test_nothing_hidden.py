"""With nothing hidden the separate bench and the model must agree, or verdicts reflect their difference."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.engine.compile import CompiledSystem, compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.model import build_system
from rigctl.physics.families import find_family
from rigctl_validation.bench import equations
from rigctl_validation.bench.parameters import BenchParameters
from rigctl_validation.bench.record import STANDARD, Condition, simulate_record
from rigctl_validation.bench.sensing import CHANNELS, Noise

FAMILY = find_family("hydraulic_cylinder")


@pytest.fixture(scope="module")
def compiled() -> CompiledSystem:
    return compile_system(build_system(FAMILY, {}, None))


@pytest.mark.parametrize("pressure", [20.0, 50.0])
@pytest.mark.parametrize("oil", [20.0, 80.0])
def test_bench_and_model_agree_to_half_the_noise_of_one_sample(
    compiled: CompiledSystem, oil: float, pressure: float
) -> None:
    condition = Condition(oil=oil + 273.15, setting=pressure * 1e5)
    trace = simulate_record(BenchParameters(), condition)
    found = simulate(compiled, [excitation(compiled, condition, trace.states[0], trace.time)]).require()
    for place, name in enumerate(found.output_names):
        difference = found.outputs[0][:, place] - trace.states[:, CHANNELS[name]]
        assert np.linalg.norm(difference) / Noise().sigma[name] < 0.5, name


def excitation(
    compiled: CompiledSystem, condition: Condition, start: np.ndarray, times: np.ndarray
) -> Excitation:
    """The standard record from the separate bench's start: the piston is pressed into its end stop."""
    system = compiled.system
    states = {"oil_temperature": "T_OIL", "spool": "SPOOL", "supply_pressure": "PS", "pressure_a": "PA",
              "pressure_b": "PB", "position": "X", "velocity": "V"}  # fmt: skip
    given = {item.name: item.value for item in FAMILY.inputs}
    given |= {"pressure_setpoint": condition.setting, "ambient_temperature": condition.ambient}
    rows = [[(given | {"valve": command})[name] for name in system.input_names] for command, _ in STANDARD]
    ends = np.cumsum([0.0, *(duration for _, duration in STANDARD)])
    return Excitation(
        times=times,
        switch_times=ends[:-1],
        inputs=np.array(rows),
        initial=np.array([start[getattr(equations, states[name])] for name in system.state_names]),
        parameters=np.array(system.nominal),
    )
