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
from rigctl.engine.compile import compile_system
from rigctl.fmu.archive import digest
from rigctl.fmu.description import read_description
from rigctl.fmu.process import FmuProcess
from rigctl.fmu.program import allow
from rigctl.model import load_model
from rigctl.model.build import build_system
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
    # of the middle of the records, from which the drift counts
    origin = values["drift_of_resistance_in_time.origin"]
    assert origin == pytest.approx(0.295)
    assert values["resistance"] == pytest.approx(2.0 + 0.8 * origin, rel=0.01)
    (model,) = answer("compare", run, *MODEL)["models"]
    assert model["adequate"]


@pytest.mark.parametrize("variability", ["fixed", "tunable"])
def test_without_a_drift_none_is_named(tmp_path: Path, variability: str) -> None:
    run = write_bench(tmp_path, resistance=constant, variability=variability)
    found = answer("diagnose", run, *MODEL, "--max-effects", "1")
    assert (found["verdict"], found["effects"]) == ("adequate", []), found["statement"]


def test_another_value_of_a_parameter_that_is_held_is_no_drift(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The winding always has 45 degC, and the resistance is held at 1.8 ohm in place of 2."""
    monkeypatch.setattr("fmu.motor_bench.WINDINGS", (45.0,) * 5)
    run = write_bench(tmp_path, resistance=constant)
    model = Path("model.yaml").read_text("utf-8")
    held = model.replace("{value: 1.8 ohm, fit: true}", "{value: 1.8 ohm, fit: false}")
    Path("model.yaml").write_text(held, encoding="utf-8")
    found = answer("diagnose", run, *MODEL, "--max-effects", "1")
    assert found["verdict"] != "adequate", found["statement"]
    assert not any("with_winding" in name for name in found["effects"]), found["statement"]


@pytest.mark.parametrize("variability", ["fixed", "tunable"])
def test_a_drift_keeps_a_parameter_within_its_bounds(tmp_path: Path, variability: str) -> None:
    """A motor without damping, whose FMU has none to give for a negative one."""
    faulty = "(m->k * current - (m->b < 0.0 ? NAN : m->b) * speed) / m->J"
    run = write_bench(
        tmp_path,
        inside=lambda speed: 1e-4 * speed,
        resistance=constant,
        acceleration=faulty,
        variability=variability,
    )
    found = answer("diagnose", run, *MODEL, "--max-effects", "1")
    assert found["effects"] == [], found["statement"]


@pytest.mark.parametrize("windings", [(20.0, 20.0, 45.0, 60.0, 30.0), (45.0, 60.0, 30.0, 20.0, 20.0)])
def test_the_order_of_the_records_does_not_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, windings: tuple[float, ...]
) -> None:
    """Not even if the first ones are at the family's own value of the condition, where nothing drifts."""
    monkeypatch.setattr("fmu.motor_bench.WINDINGS", windings)
    run = write_bench(tmp_path, resistance=warm)
    found = answer("diagnose", run, *MODEL, "--max-effects", "1")
    assert found["effects"] == ["drift_of_resistance_with_winding"], found["statement"]


def test_what_is_added_to_another_parameter_is_another_system(tmp_path: Path) -> None:
    """By the digest of a system results of earlier commands are found."""
    write_bench(tmp_path, resistance=constant)
    allow(digest(Path("motor.fmu")))
    model = load_model("model.yaml")
    digests = set()
    for name in ("resistance", "kt", "damping"):
        effect = {f"drift_of_{name}_with_voltage": {"slope": 0.0}}
        digests.add(compile_system(build_system(model.family, effect, model.rig)).source.digest)
    assert len(digests) == 3


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


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "voltage: {value: 0 V}",
            "drifts with the inputs of the FMU are looked for without this, got 'voltage'",
        ),
        ("speed: {value: 0 rad/s}", "an output has this name already, got 'speed'"),
        ("kt: {value: 0 N*m/A}", "a parameter has this name already, got 'kt'"),
    ],
)
def test_a_condition_that_is_something_else_is_refused_at_its_line(
    tmp_path: Path, name: str, message: str
) -> None:
    run = write_bench(tmp_path, resistance=constant)
    lines = Path("family.yaml").read_text("utf-8").splitlines()
    at = lines.index("conditions:")
    lines.insert(at + 1, f"  {name}")
    Path("family.yaml").write_text("\n".join(lines), encoding="utf-8")
    said = refusal("compare", run, *MODEL)
    assert f"family.yaml:{at + 2}:" in said
    assert message in said


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
