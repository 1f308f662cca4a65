"""An FMU as a model, by whole commands: a motor in C."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from commands import answer, refusal, told
from fmu.motor_bench import fitted, write_bench
from rigctl.cli.main import app
from rigctl.errors import RigctlError
from systems import needs_compiler

pytestmark = needs_compiler


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
    assert "nly effects at inputs, outputs and parameters of motor.fmu were searched" in found["statement"]
    assert not any(one["place"]["sure"] for one in found["levels"])
    said = told("diagnose", run, "--model", "model.yaml", "--family", "motor.fmu", "--max-effects", "1")
    assert "the cause may be something else inside the FMU" in " ".join(said.split())
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
    assert "nly effects at inputs, outputs and parameters of motor.fmu were searched" in found["statement"]
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
    parameters = {"resistance_parameter", "kt_parameter", "damping_parameter"}
    assert set(slots) - parameters == {"voltage_input", "voltage_delay", "current_reading", "speed_reading"}
    for parameter in parameters:  # which the description calls fixed
        assert slots[parameter]["why_not"] == "no drift in time: it cannot change during a simulation"
    assert "lag_of_speed" in slots["speed_reading"]["effects"]
    assert "dead_band_of_voltage" in slots["voltage_input"]["effects"]


def test_it_is_not_exported_again(tmp_path: Path) -> None:
    write_bench(tmp_path)
    said = refusal("model", "export", "model.yaml", "-o", "again.fmu", "--family", "motor.fmu")
    assert "a model that the FMU computes already has no equations to export" in said


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
