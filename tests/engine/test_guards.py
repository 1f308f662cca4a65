"""Nothing is written past an array: whole and degenerate systems with the guards of RIGCTL_DEBUG=1."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.guards import DEBUG_VARIABLE, Result, Workspace
from rigctl.engine.kernels import sizes as sizing
from rigctl.engine.simulate import simulate
from rigctl.engine.stepper import Stepper
from rigctl.engine.system import Delay, System, SystemBuilder
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model.build import build_system
from rigctl.model.load import load_model
from rigctl.model.standard_record import standard_excitation
from rigctl.physics.user import load_family


def pump() -> System:
    """``head = shut_off - slope*flow``: no state at all."""
    builder = SystemBuilder()
    flow = builder.input("flow", "m^3/s")
    shut_off = builder.parameter("shut_off", "m", 20.0)
    slope = builder.parameter("slope", "s/m^2", 3.0)
    builder.output("head", "m", shut_off - slope * flow)
    return builder.build()


def still() -> System:
    """One output, one parameter, and nothing else."""
    builder = SystemBuilder()
    builder.output("level", "m", builder.parameter("level_0", "m", 2.0))
    return builder.build()


def free() -> System:
    """A state without input, output or parameter."""
    builder = SystemBuilder()
    state = builder.state("x", "m", 1.0)
    builder.equation("x", -state / builder.constant(2.0, "s"))
    return builder.build()


def late() -> System:
    """A static output with a delayed input."""
    builder = SystemBuilder()
    valve = builder.input("valve", "1")
    dead_time = builder.parameter("dead_time", "s", 0.25)
    builder.output("reading", "1", valve)
    built = builder.build()
    return System(
        built.graph, (), built.inputs, built.parameters, (), built.outputs, (Delay("valve", dead_time),)
    )


def record(system: System, commands: int = 5) -> Excitation:
    """A command each second, and samples between them."""
    rng = np.random.default_rng(0)
    return Excitation(
        times=np.arange(0.5, commands, 0.5),
        switch_times=np.arange(float(commands)),
        inputs=rng.uniform(0.0, 1.0, (commands, len(system.inputs))),
        initial=np.ones(len(system.states)),
        parameters=np.array(system.nominal),
    )


def test_a_static_system_follows_its_inputs_at_once() -> None:
    compiled = compile_system(pump())
    given = record(compiled.system)
    found = simulate(compiled, [given], columns=("shut_off", "slope")).require()
    held = given.inputs[np.searchsorted(given.switch_times, given.times, side="left") - 1, 0]
    assert found.outputs[0][:, 0] == pytest.approx(20.0 - 3.0 * held)
    assert found.sensitivities[0][:, 0, 0] == pytest.approx(1.0)
    assert found.sensitivities[0][:, 0, 1] == pytest.approx(-held)
    bench = Stepper(compiled, [], [20.0, 3.0], [0.5])
    assert bench.outputs() == pytest.approx([18.5])
    bench.advance(2.0, [1.0])
    assert (bench.time, bench.outputs()) == (2.0, pytest.approx([17.0]))


def test_a_static_system_waits_for_a_delayed_input() -> None:
    compiled = compile_system(late())
    given = Excitation([0.1, 1.2, 1.3], [0.0, 1.0], [[0.0], [1.0]], [], [0.25])
    assert simulate(compiled, [given]).outputs[0][:, 0].tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize("make", [pump, still, free, late])
@pytest.mark.parametrize("sensitive", [False, True])
def test_degenerate_systems_are_integrated(make: object, sensitive: bool) -> None:
    compiled = compile_system(make())  # type: ignore[operator]
    system = compiled.system
    columns = system.parameter_names if sensitive else ()
    starts = system.state_names if sensitive else ()
    found = simulate(compiled, [record(system)], columns=columns, initial_columns=starts).require()
    assert found.outputs[0].shape == (9, len(system.outputs))
    assert found.sensitivities[0].shape == (9, len(system.outputs), len(columns) + len(starts))


def test_a_write_beyond_an_array_is_reported_with_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DEBUG_VARIABLE, "1")
    sizes = np.zeros(sizing.SIZES, dtype=np.int64)
    sizes[[sizing.N, sizing.GUARD]] = 2, 4
    workspace = Workspace(sizes)
    workspace.floats[:2] = 1.0
    workspace.check()
    workspace.floats[2] = 1.0
    with pytest.raises(RigctlError, match="wrote past the array 'y'"):
        workspace.check()
    result = Result("outputs", (3, 2))
    result.values[:] = 1.0
    result.check()
    np.lib.stride_tricks.as_strided(result.values, (7,), (8,))[6] = 0.0
    with pytest.raises(RigctlError, match="wrote past the array 'outputs'"):
        result.check()


@pytest.mark.parametrize("name", ["hl32-textbook", "hl32-oil", "heater-board", "families/water-tank"])
def test_shipped_systems_are_integrated_with_their_derivatives(name: str) -> None:
    path = shipped("models", f"{name}.yaml")
    if name.startswith("families"):
        family = load_family(path)
        system = build_system(family, [])
    else:
        model = load_model(path)
        family, system = model.family, model.system()
    given = standard_excitation(family, system, system.nominal, {})
    given = Excitation(
        given.times[given.times < 2.0 * given.times[20]],
        given.switch_times,
        given.inputs,
        given.initial,
        given.parameters,
    )
    found = simulate(compile_system(system), [given], columns=system.parameter_names[:4])
    assert found.require().sensitivities[0].shape[2] == len(system.parameter_names[:4])


def test_nothing_is_written_beyond_an_array() -> None:
    """The tests of this file, of delays and of the stepper, run again with the checks on."""
    environment = {**os.environ, DEBUG_VARIABLE: "1"}
    here, itself = (
        Path(__file__),
        test_nothing_is_written_beyond_an_array.__name__,
    )  # which starts this process
    chosen = [str(here), str(here.with_name("test_delays.py")), str(here.with_name("test_stepper.py"))]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "-n",
            "0",
            "-k",
            f"not {itself}",
            *chosen,
        ],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:]
