"""An FMU as a model, by whole commands: a motor in C, and logs that SciPy makes of a motor of its own."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from commands import answer, refusal, told
from foreign_fmus import motor_fmu
from rigctl.cli.main import app
from rigctl.errors import RigctlError
from systems import needs_compiler

pytestmark = needs_compiler

PARAMETERS = """
  resistance: {VARIABLE_R value: 1.8 ohm, bounds: [0.1 ohm, 100 ohm]}
  kt: {VARIABLE_k value: 0.045 N*m/A, bounds: [0.001 N*m/A, 1 N*m/A]}
  damping: {VARIABLE_b value: 2e-4 N*m*s/rad, bounds: [0 N*m*s/rad, 0.1 N*m*s/rad]}
"""
FAMILY = f"""
family: motor_fmu
fmu: motor.fmu
inputs:
  voltage: {{value: 0 V}}
parameters:{PARAMETERS.replace("VARIABLE_", "variable: ").replace(" value", ", value")}
outputs:
  current: {{unit: A, scale: 1 mA}}
  speed: {{unit: rad/s, scale: 0.1 rad/s}}
"""
#: the same motor in equations
EQUATIONS = f"""
family: motor
states:
  current: {{start: 0 A, scale: 1 mA, rate: (voltage - resistance*current - kt*speed)/inductance}}
  speed: {{start: 0 rad/s, scale: 0.1 rad/s, rate: (kt*current - damping*speed)/inertia}}
inputs:
  voltage: {{value: 0 V}}
parameters:{PARAMETERS.replace("VARIABLE_R", "").replace("VARIABLE_k", "").replace("VARIABLE_b", "")}
constants: {{inertia: 2e-4 kg*m^2, inductance: 20 mH}}
outputs:
  current: {{unit: A, formula: current}}
  speed: {{unit: rad/s, formula: speed}}
"""
RIG = """
name: motor
channels:
  current: {unit: A, quantity: current, noise: 10 mA}
  speed: {unit: rad/s, quantity: other, noise: 0.3 rad/s}
actuators:
  voltage: {kind: level, unit: V, low: -24 V, high: 24 V}
safe_state: {voltage: 0 V}
"""
MODEL = """
rig: rig.yaml
parameters:
  resistance: {value: 1.8 ohm, fit: true}
  kt: {value: 0.045 N*m/A, fit: true}
  damping: {value: 2e-4 N*m*s/rad, fit: true}
"""
PERIOD = 10e-3
VOLTAGES = (3.0, 6.0, -9.0, 12.0, 1.5)

Floats = NDArray[np.float64]


def write_bench(
    folder: Path,
    *,
    inside: Callable[[float], float] = lambda speed: 0.0,
    command: Callable[[float], float] = lambda volts: volts,
    reading: Callable[[Floats], Floats] = lambda speed: speed,
    version: str = "2.0",
    acceleration: str | None = None,
) -> str:
    """The files of the bench; the log has what is missing inside the motor, at its command or at a reading.

    Returns the run into which the log is imported.
    """
    given = {} if acceleration is None else {"acceleration": acceleration}
    motor_fmu(folder / "motor.fmu", version, **given)
    files = {"family": FAMILY, "equations": EQUATIONS, "rig": RIG}
    files |= {"model": f"model: family.yaml\n{MODEL}", "written": f"model: equations.yaml\n{MODEL}"}
    for name, text in files.items():
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    rng = np.random.default_rng(7)
    times = np.arange(60) * PERIOD

    def rates(t: float, y: Any, volts: float) -> list[float]:
        return [
            (volts - 2.0 * y[0] - 0.05 * y[1]) / 20e-3,
            (0.05 * y[0] - 1e-4 * y[1] + inside(y[1])) / 2e-4,
        ]

    with (folder / "log.csv").open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream)
        rows.writerow(["time [s]", "record", "voltage [V]", "current [A]", "speed [rad/s]"])
        for record, volts in enumerate(VOLTAGES, start=1):
            found = solve_ivp(
                rates,
                (0.0, times[-1]),
                (0.0, 0.0),
                t_eval=times,
                args=(command(volts),),
                rtol=1e-9,
                atol=1e-10,
            )
            current = found.y[0] + 0.01 * rng.standard_normal(times.size)
            speed = reading(found.y[1]) + 0.3 * rng.standard_normal(times.size)
            for time, *values in zip(times, current, speed, strict=True):
                rows.writerow([f"{time:.6g}", record, volts, *(f"{value:.7g}" for value in values)])
    return str(answer("import", "log.csv", "--rig", "rig.yaml")["run"])


def fitted(found: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """The value and the standard deviation of each parameter of a comparison."""
    (model,) = found["models"]
    return {name: (one["value"], one["std"]) for name, one in model["parameters"].items()}


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_it_is_fitted_as_the_same_model_in_equations(tmp_path: Path, version: str) -> None:
    run = write_bench(tmp_path, version=version)
    found = answer("compare", run, "--model", "model.yaml", "--family", "motor.fmu")
    assert found["models"][0]["adequate"], found
    expected = fitted(answer("compare", run, "--model", "written.yaml"))
    for name, (value, std) in fitted(found).items():
        assert value == pytest.approx(expected[name][0], abs=0.1 * std)
        assert std == pytest.approx(expected[name][1], rel=0.1)


def diagnosed(run: str) -> dict[str, Any]:
    return answer("diagnose", run, "--model", "model.yaml", "--family", "motor.fmu", "--max-effects", "1")


def test_an_effect_at_its_edge_is_found_and_not_called_certain(tmp_path: Path) -> None:
    run = write_bench(tmp_path, reading=lambda speed: speed + 4.0)
    found = diagnosed(run)
    assert found["verdict"] == "ambiguous", found["statement"]
    assert found["effects"] == ["offset_of_speed"]
    assert "nly effects at the inputs and outputs of motor.fmu were searched" in found["statement"]
    assert not any(one["place"]["sure"] for one in found["levels"])
    said = told("diagnose", run, "--model", "model.yaml", "--family", "motor.fmu", "--max-effects", "1")
    assert "the cause may be inside the FMU" in " ".join(said.split())
    size = found["ranking"][0]["parameters"]["size"]
    assert size["value"] == pytest.approx(4.0, abs=3.0 * size["std"])


def test_an_effect_on_its_command_is_found(tmp_path: Path) -> None:
    run = write_bench(tmp_path, command=lambda volts: float(np.sign(volts) * max(abs(volts) - 0.8, 0.0)))
    found = diagnosed(run)
    assert (found["verdict"], found["effects"]) == ("ambiguous", ["dead_band_of_voltage"]), found["statement"]


def test_where_nothing_is_missing_it_is_adequate(tmp_path: Path) -> None:
    found = diagnosed(write_bench(tmp_path))
    assert (found["verdict"], found["effects"]) == ("adequate", []), found["statement"]


def test_a_cause_inside_it_is_not_taken_for_an_effect_at_its_edge(tmp_path: Path) -> None:
    run = write_bench(tmp_path, inside=lambda speed: -2e-6 * speed * abs(speed))
    found = diagnosed(run)
    assert found["verdict"] in ("ambiguous", "outside_library"), found["statement"]
    assert "nly effects at the inputs and outputs of motor.fmu were searched" in found["statement"]
    assert "inside the FMU" in found["statement"]
    assert not any(one["place"]["sure"] for one in found["levels"])
    if found["effects"]:  # none is described by an effect that may as well be none
        sizes = found["ranking"][0]["parameters"].values()
        assert any(one["std"] and abs(one["value"]) > 2.0 * one["std"] for one in sizes)


def test_an_fmu_that_only_a_file_names_is_not_run(tmp_path: Path) -> None:
    run = write_bench(tmp_path)
    said = refusal("compare", run, "--model", "model.yaml")
    assert "motor.fmu: an FMU is a program, and is not run because a file names it" in said
    assert "--family" in said


def test_its_effects_are_listed_without_running_it(tmp_path: Path) -> None:
    write_bench(tmp_path, acceleration="abort(), 0.0")
    slots = {one["slot"]: one for one in answer("effects", "list", "--family", "family.yaml")["generic"]}
    assert set(slots) == {"voltage_input", "voltage_delay", "current_reading", "speed_reading"}
    assert "lag_of_speed" in slots["speed_reading"]["effects"]
    assert "dead_band_of_voltage" in slots["voltage_input"]["effects"]


def test_it_is_not_exported_again(tmp_path: Path) -> None:
    write_bench(tmp_path)
    said = refusal("model", "export", "model.yaml", "-o", "again.fmu", "--family", "motor.fmu")
    assert "the equations of this model are in an FMU already" in said


def test_an_effect_is_added_and_fitted_with_its_parameters(tmp_path: Path) -> None:
    run = write_bench(tmp_path, reading=lambda speed: speed + 4.0)
    told("model", "add", "model.yaml", "offset_of_speed", run, "--family", "motor.fmu")
    found = answer("model", "show", "model.yaml", "--family", "motor.fmu")
    values = {one["name"]: one["value"] for one in found["parameters"]}
    assert values["offset_of_speed.size"] == pytest.approx(4.0, abs=0.15)
    assert values["resistance"] == pytest.approx(2.0, abs=0.006)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("abort(), 0.0", r"motor\.fmu: .*the FMU has crashed \(exit code "),
        ("m->time > 0.2 ? NAN : 0.0", r"motor\.fmu failed at 0\.2\d* s: current is nan"),
    ],
    ids=["crash", "nan"],
)
def test_a_fault_of_it_ends_the_command_with_one_message(tmp_path: Path, fault: str, said: str) -> None:
    run = write_bench(tmp_path, acceleration=fault)
    arguments = ("compare", run, "--model", "model.yaml", "--family", "motor.fmu")
    with pytest.raises(RigctlError, match=said):
        CliRunner().invoke(app, list(arguments), catch_exceptions=False)
