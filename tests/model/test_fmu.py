"""Models as FMUs, run by FMPy and compared with the engine at a tighter tolerance."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu
from fmpy.util import fmu_info
from fmpy.validation import validate_fmu

from commands import refusal, told
from rigctl.effects.registry import find_effect
from rigctl.engine.compile import compile_system
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.tolerance import Tolerance
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model import Model, load_model
from rigctl.model.fmu import export_fmu
from systems import needs_compiler

#: commands of each input: (time, value from then on)
STROKE = {"valve": [(0.0, 0.0), (0.2, 1.0), (1.2, 0.0), (1.5, -1.0)], "pressure_setpoint": [(0.0, 30e5)]}
HEAT = {"heater_1": [(0.0, 0.0), (1.0, 0.6)], "heater_2": [(0.0, 0.0), (1.3, 0.3)]}
END = 2.0


def model(name: str, *effects: str) -> Model:
    found = load_model(shipped("models", name))
    for effect in effects:
        found = found.with_effect(effect, find_effect(effect, found.family).start)
    return found


def rows(found: Model, commands: dict[str, list[tuple[float, float]]], base: list[float]) -> tuple[Any, Any]:
    """Switch times, and all inputs from each of them on."""
    names = found.system().input_names
    times = sorted({time for switches in commands.values() for time, _ in switches})
    inputs = np.tile(np.array(base), (len(times), 1))
    for name, switches in commands.items():
        for at, value in switches:
            inputs[np.array(times) >= at, names.index(name)] = value
    return np.array(times), inputs


def both(found: Model, path: Path, commands: dict[str, list[tuple[float, float]]], **start: float) -> Any:
    """The outputs of FMPy and of the engine for the same commands."""
    description = read_model_description(str(path))
    given = {one.name: float(one.start) for one in description.modelVariables if one.start is not None}
    system = found.system()
    times = np.linspace(0.0, END, 201)
    switches, inputs = rows(found, commands, [given[name] for name in system.input_names])
    excitation = Excitation(
        times,
        switches,
        inputs,
        np.array([given[f"state.{name}"] for name in system.state_names]),
        np.array(
            [
                start.get(name, value)
                for name, value in zip(system.parameter_names, system.nominal, strict=True)
            ]
        ),
    )
    exact = simulate(compile_system(system), [excitation], tolerance=Tolerance(1e-11, 1e-8)).outputs[0]
    steps = []
    for index, time in enumerate(switches):
        if index:
            steps.append((time - 1e-12, *inputs[index - 1]))
        steps.append((time, *inputs[index]))
    signals = np.array(steps, dtype=[("time", float), *((name, float) for name in system.input_names)])
    found_there = simulate_fmu(
        str(path),
        stop_time=END,
        output_interval=0.01,
        input=signals,
        start_values=start,
        relative_tolerance=1e-9,
    )
    return system.output_names, found_there, exact


@needs_compiler
@pytest.mark.parametrize(
    ("name", "effects", "commands"),
    [
        ("heater-board.yaml", (), HEAT),
        ("hl32-textbook.yaml", (), STROKE),
        ("hl32-textbook.yaml", ("valve_open_delay", "piston_leakage", "stribeck_friction"), STROKE),
    ],
)
def test_an_fmu_agrees_with_the_engine(
    tmp_path: Path, name: str, effects: tuple[str, ...], commands: dict[str, list[tuple[float, float]]]
) -> None:
    found = model(name, *effects)
    path = tmp_path / "m.fmu"
    export_fmu(found, path)
    assert validate_fmu(str(path)) == []
    names, there, exact = both(found, path, commands)
    for index, output in enumerate(names):
        span = max(float(np.ptp(exact[:, index])), 1e-9 * float(np.abs(exact[:, index]).max()))
        assert np.abs(there[output] - exact[:, index]).max() <= 1e-6 * span, output


@needs_compiler
def test_parameters_of_an_fmu_can_be_set(tmp_path: Path) -> None:
    found, path = model("hl32-textbook.yaml"), tmp_path / "m.fmu"
    export_fmu(found, path)
    _, before, _ = both(found, path, STROKE)
    _, there, exact = both(found, path, STROKE, flow_area=2e-6)
    stroke = there["position"].max()
    assert stroke < 0.8 * before["position"].max()
    assert np.abs(there["position"] - exact[:, 2]).max() <= 1e-6 * stroke


@needs_compiler
def test_a_step_can_be_reverted(tmp_path: Path) -> None:
    path = tmp_path / "m.fmu"
    export_fmu(model("hl32-textbook.yaml"), path)
    description = read_model_description(str(path))
    known = {one.name: one.valueReference for one in description.modelVariables}
    slave = instantiate_fmu(extract(str(path), str(tmp_path / "unzipped")), description, "CoSimulation")
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.setReal([known["valve"]], [1.0])
    slave.doStep(0.0, 0.1)
    kept = slave.getFMUState()
    slave.doStep(0.1, 0.1)
    first = slave.getReal([known["position"]])
    slave.setFMUState(kept)
    slave.doStep(0.1, 0.1)
    assert slave.getReal([known["position"]]) == first
    slave.freeFMUState(kept)
    with pytest.raises(FMICallException):
        slave.setReal([known["valve"]], [float("nan")])
    with pytest.raises(FMICallException):
        slave.doStep(5.0, 0.1)
    with pytest.raises(FMICallException):
        slave.setReal([known["flow_area"]], [1e-6])
    slave.terminate()
    slave.freeInstance()


@needs_compiler
def test_the_export_command_reports_the_fmu_and_refuses_wrong_targets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    source = str(shipped("models", "heater-board.yaml"))
    assert "2 states, 3 inputs, 4 parameters, 2 outputs, compiled for" in told(
        "model", "export", source, "-o", "board.fmu"
    )
    assert "heater_1" in fmu_info("board.fmu")
    assert "ends in .fmu" in refusal("model", "export", source, "-o", "board.zip")
    assert "unknown form" in refusal("model", "export", source, "--to", "fmx")
    told("model", "export", source, "-o", "one.fmu", "--sources-only")
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(RigctlError, match="there is no C compiler"):
        export_fmu(load_model(source), tmp_path / "none.fmu")
    assert not (tmp_path / "none.fmu").exists()
    with pytest.raises(RigctlError, match=r"one\.fmu"):
        told("model", "export", source, "-o", "one.fmu", "--sources-only")
