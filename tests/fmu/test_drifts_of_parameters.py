"""Drifts of the parameters of an FMU and of functions: with a condition, and in the course of a record."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import answer, refusal, told
from fmu.motor_bench import write_bench
from foreign_fmus import lag_fmu
from rigctl.fmu.description import read_description
from rigctl.fmu.process import FmuProcess
from systems import needs_compiler

pytestmark = needs_compiler

MODEL = ("--model", "model.yaml", "--family", "motor.fmu")


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def constant(time: float, volts: float, winding: float) -> float:
    return 2.0


def warm(time: float, volts: float, winding: float) -> float:
    return 2.0 * (1.0 + 0.004 * (winding - 20.0))


def loaded(time: float, volts: float, winding: float) -> float:
    return 2.0 + 0.02 * volts


def aging(time: float, volts: float, winding: float) -> float:
    return 2.0 + 0.8 * time


@pytest.mark.parametrize("variability", ["fixed", "tunable"])
@pytest.mark.parametrize(
    ("law", "effect", "parameter", "size"),
    [
        (warm, "drift_of_resistance_with_winding", "slope", 0.008),  # ohm/K
        (loaded, "drift_of_resistance_with_voltage", "slope", 0.02),  # ohm/V
    ],
)
def test_a_drift_with_a_condition_is_found(
    tmp_path: Path,
    law: Callable[[float, float, float], float],
    effect: str,
    parameter: str,
    size: float,
    variability: str,
) -> None:
    run = write_bench(tmp_path, resistance=law, variability=variability)
    found = answer("diagnose", run, *MODEL, "--max-effects", "1")
    assert (found["verdict"], found["effects"]) == ("ambiguous", [effect]), found["statement"]
    assert not any(one["place"]["sure"] for one in found["levels"])
    fitted = found["ranking"][0]["parameters"][parameter]
    assert fitted["value"] == pytest.approx(size, abs=3.0 * fitted["std"])
    assert fitted["std"] < 0.1 * size


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_drift_in_time_is_found_added_and_fitted(tmp_path: Path, version: str) -> None:
    run = write_bench(tmp_path, resistance=aging, variability="tunable", version=version)
    told("diagnose", run, *MODEL, "--max-effects", "1", "--apply")
    shown = answer("model", "show", "model.yaml", "--family", "motor.fmu")
    assert [one["effect"] for one in shown["effects"]] == ["drift_of_resistance_in_time"]
    values = {one["name"]: one["value"] for one in shown["parameters"]}
    assert values["drift_of_resistance_in_time.rate"] == pytest.approx(0.8, rel=0.1)
    assert values["resistance"] == pytest.approx(2.0, rel=0.01)
    (model,) = answer("compare", run, *MODEL)["models"]
    assert model["adequate"]


@pytest.mark.parametrize("variability", ["fixed", "tunable"])
def test_without_a_drift_none_is_named(tmp_path: Path, variability: str) -> None:
    run = write_bench(tmp_path, resistance=constant, variability=variability)
    found = answer("diagnose", run, *MODEL, "--max-effects", "1")
    assert (found["verdict"], found["effects"]) == ("adequate", []), found["statement"]


def test_which_drifts_are_looked_for_is_listed(tmp_path: Path) -> None:
    write_bench(tmp_path, resistance=constant, variability="tunable")
    slots = {one["slot"]: one for one in answer("effects", "list", "--family", "family.yaml")["generic"]}
    assert set(slots["kt_parameter"]["effects"]) == {
        "drift_of_kt_with_voltage",
        "drift_of_kt_with_winding",
        "drift_of_kt_in_time",
    }
    # the FMU does not have it: nothing acts on it
    assert not {"winding_input", "winding_delay"} & set(slots)


USERS = """
effect: heating
family: family.yaml
summary: The winding warms up.
slot: resistance_parameter
term: slope*TERM
parameters:
  slope: {null_value: 0 ohm/V, start: 0.01 ohm/V, bounds: [-1 ohm/V, 1 ohm/V]}
"""


def test_an_effect_of_the_users_acts_on_a_parameter(tmp_path: Path) -> None:
    run = write_bench(tmp_path, resistance=loaded)
    Path("heating.yaml").write_text(USERS.replace("TERM", "voltage"), encoding="utf-8")
    told("model", "add", "model.yaml", "heating.yaml", run, "--family", "motor.fmu")
    values = {
        one["name"]: one["value"]
        for one in answer("model", "show", "model.yaml", "--family", "motor.fmu")["parameters"]
    }
    assert values["heating.slope"] == pytest.approx(0.02, rel=0.02)


def test_an_effect_on_a_parameter_that_depends_on_an_output_is_refused(tmp_path: Path) -> None:
    run = write_bench(tmp_path, resistance=loaded)
    text = USERS.replace("ohm/V", "ohm*s/rad").replace("TERM", "speed")
    Path("heating.yaml").write_text(text, encoding="utf-8")
    said = refusal("model", "add", "model.yaml", "heating.yaml", run, "--family", "motor.fmu")
    assert "what motor.fmu is given depends on what it computes" in said
    assert "effects on its inputs and parameters that use inputs alone" in said


def test_a_condition_that_is_an_input_already_is_refused(tmp_path: Path) -> None:
    run = write_bench(tmp_path, resistance=constant)
    family = (
        Path("family.yaml")
        .read_text("utf-8")
        .replace("  winding: {", "  voltage: {value: 0 V}\n  winding: {")
    )
    Path("family.yaml").write_text(family, encoding="utf-8")
    said = refusal("compare", run, *MODEL)
    assert "family.yaml" in said
    assert "an input is a condition for its parameters already" in said


@pytest.mark.parametrize(
    ("version", "kind"), [("2.0", "ModelExchange"), ("3.0", "ModelExchange"), ("3.0", "CoSimulation")]
)
def test_a_tunable_parameter_changes_during_a_simulation(tmp_path: Path, version: str, kind: str) -> None:
    """T·y' = u − y, with u = 1, and T from 0.5 s to 2 s at 1 s."""
    path = lag_fmu(tmp_path / "lag.fmu", version, kind, variability="tunable")
    about = read_description(path)
    ports = {name: about.port(name) for name in ("u", "y", "T")}
    times = np.linspace(0.0, 2.0, 201)
    drives = np.column_stack([np.ones(200), np.where(times[:-1] < 1.0 - 1e-9, 0.5, 2.0)])
    process: Any = FmuProcess(
        path, about.kind, [ports["u"]], [ports["y"]], [ports["T"]], tunable=[ports["T"]]
    )
    with process:
        reason, rows = process.attempt("it", times, drives, np.array([0.5]))
        _, plain = process.attempt("it", times, drives[:, :1], np.array([0.5]))
    assert reason == ""
    first = 1.0 - np.exp(-np.minimum(times, 1.0) / 0.5)
    exact = 1.0 - (1.0 - first) * np.exp(-np.maximum(times - 1.0, 0.0) / 2.0)
    np.testing.assert_allclose(rows[:, 0], exact, atol=1e-5)
    np.testing.assert_allclose(plain[:, 0], 1.0 - np.exp(-times / 0.5), atol=1e-5)
