"""A number that a file only assumes makes others conditional: they are given over its range."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from commands import answer, refusal, told
from rigctl.analysis.bootstrap import bootstrap
from rigctl.analysis.comparison import compare
from rigctl.dataset import Run, open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.errors import RigctlError
from rigctl.model.fit.assumptions import conditional_numbers
from rigctl.model.load import load_model
from rigctl.model.model import Model
from rigctl.physics.user import parse_family
from rigctl.rig.load import load_rig
from rigctl.tasks import Workers

#: ohm, V/(rad/s), kg*m^2, N*m of the motor itself; its files assume 1 ohm
RESISTANCE, CONSTANT, INERTIA, FRICTION = 1.7, 0.08, 4e-4, 0.006

FAMILY = """
family: spindle
title: Motor with dry friction
states:
  speed:
    start: 0 rad/s
    scale: 0.1 rad/s
    rate: >
      (torque_per_ampere*(voltage - torque_per_ampere*speed)/resistance
      - friction*tanh(speed/(0.5 rad/s)) + torque)/inertia
inputs:
  voltage: {value: 0 V, meaning: commanded}
parameters:
  resistance: {value: 1 ohm, bounds: [0.01 ohm, 100 ohm]%s}
  torque_per_ampere: {value: 0.1 V*s/rad, bounds: [0.001 V*s/rad, 10 V*s/rad]}
  inertia: {value: 1e-3 kg*m^2, bounds: [1e-6 kg*m^2, 1 kg*m^2]}
  friction: {value: 0.01 N*m, bounds: [1e-5 N*m, 1 N*m]}
slots:
  torque: {unit: N*m, meaning: on the shaft}
outputs:
  speed: {unit: rad/s, formula: speed}
"""
RIG = """
name: spindle
model: families/spindle.yaml
channels:
  speed: {unit: rad/s, quantity: angular_speed}
actuators:
  voltage: {kind: level, unit: V, low: 0 V, high: 24 V}
safe_state: {voltage: 0 V}
"""
MODEL = """
model: families/spindle.yaml
rig: rigs/spindle.yaml
parameters:
  resistance: {value: 1 ohm%s}
  torque_per_ampere: {value: 0.1 V*s/rad, fit: true}
  inertia: {value: 1e-3 kg*m^2, fit: true}
  friction: {value: 0.01 N*m, fit: true}
"""


def spindle(folder: Path, *, family: str = "", model: str = "") -> tuple[Run, Model]:
    """A user's folder with a log, imported; `family` and `model` are further fields of the resistance."""
    for name, text in {
        "families/spindle.yaml": FAMILY % family,
        "rigs/spindle.yaml": RIG,
        "models/spindle.yaml": MODEL % model,
        "rigctl.toml": "",
    }.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    voltage = np.repeat([0.0, 4.0, 12.0, 2.0, 8.0, 0.0], 80)
    speed, values = 0.0, np.empty(voltage.size)
    for k, volts in enumerate(voltage):
        values[k] = speed
        for _ in range(100):
            torque = CONSTANT * (volts - CONSTANT * speed) / RESISTANCE - FRICTION * np.tanh(speed / 0.5)
            speed += 0.02 / 100 * torque / INERTIA
    values += 0.05 * np.random.default_rng(8).standard_normal(values.size)
    rows = np.column_stack([np.arange(values.size) * 0.02, voltage, np.round(values, 3)])
    log = folder / "log.csv"
    np.savetxt(log, rows, "%.7g", ",", header="time [s],voltage [V],speed [rad/s]", comments="")
    run = import_file(log, load_rig(folder / "rigs/spindle.yaml"), folder / "runs").path
    return open_run(run), load_model(folder / "models/spindle.yaml")


@pytest.mark.parametrize("where", ["family", "model"])
def test_the_range_of_a_number_that_rests_on_a_guess_holds_the_truth(tmp_path: Path, where: str) -> None:
    run, model = spindle(tmp_path, **{where: ", standing: assumed"})
    assert dict(model.assumed) == {"resistance": (0.5, 2.0)}
    (found,) = compare([run], [model]).models
    assert found.adequate
    values = {one.name: float(v) for one, v in zip(found.fit.problem.shared, found.fit.values, strict=True)}
    assert values["resistance"] == pytest.approx(1.0, rel=0.01)
    given = conditional_numbers(found.fit)
    assert set(given) == {"inertia", "friction"}  # the constant is determined by the speeds alone
    for name, truth in (("friction", FRICTION), ("inertia", INERTIA)):
        one = given[name]
        assert values[name] == pytest.approx(truth * RESISTANCE, rel=0.05)
        assert one.low < truth < one.high
        assert one.low == pytest.approx(0.5 * values[name], rel=0.1)
        assert one.high == pytest.approx(2.0 * values[name], rel=0.1)
    document = found.document()["parameters"]
    assert (
        document["torque_per_ampere"]["depends_on"] == []
        and document["torque_per_ampere"]["over_range"] is None
    )
    assert document["friction"]["depends_on"] == [
        {"parameter": "resistance", "value": pytest.approx(1.0, rel=0.01), "range": [0.5, 2.0], "unit": "ohm"}
    ]


def test_a_bootstrap_repeats_the_guess_too(tmp_path: Path) -> None:
    """Signs of residuals say nothing about one prior: without draws of it, the guess would be exact."""
    run, model = spindle(tmp_path, model=", standing: assumed")
    again = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1)
    again[:, 2] += 0.05 * np.random.default_rng(9).standard_normal(len(again))
    np.savetxt(
        tmp_path / "log-2.csv", again, "%.7g", ",", header="time [s],voltage [V],speed [rad/s]", comments=""
    )
    second = import_file(tmp_path / "log-2.csv", load_rig(tmp_path / "rigs/spindle.yaml"), tmp_path / "runs")
    (found,) = compare([run, open_run(second.path)], [model]).models
    scatter = {one.name: one for one in bootstrap(found.fit, 24, workers=Workers(1)).parameters}
    assert 0.5 < scatter["friction"].std / scatter["friction"].fit_std < 1.6
    assert scatter["friction"].low < 1.2 * FRICTION < scatter["friction"].high


def test_without_a_standing_a_fixed_number_is_exact_as_before(tmp_path: Path) -> None:
    run, model = spindle(tmp_path)
    assert not model.assumed
    (found,) = compare([run], [model]).models
    assert [one.name for one in found.fit.problem.shared if one.prior is None] == [
        "torque_per_ampere",
        "inertia",
        "friction",
    ]
    assert conditional_numbers(found.fit) == {}


def test_a_value_of_ones_own_is_exact_unless_its_standing_is_stated(tmp_path: Path) -> None:
    _, model = spindle(tmp_path, family=", standing: assumed")
    assert set(model.assumed) == {"resistance"}
    (tmp_path / "models/spindle.yaml").write_text((MODEL % "").replace("1 ohm", "1.7 ohm"), encoding="utf-8")
    assert not load_model(tmp_path / "models/spindle.yaml").assumed


def test_commands_give_sizes_over_the_range(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spindle(tmp_path, family=", standing: assumed, range: [0.4 ohm, 3 ohm]")
    monkeypatch.chdir(tmp_path)
    assert "assumed, 0.4 to 3" in told("model", "show", "models/spindle.yaml")
    assert "assumed: resistance" in told("check", "models/spindle.yaml")
    printed = told("model", "fit", "models/spindle.yaml", "latest")
    assert re.search(
        r"friction 0\.01 N\*m if resistance = (1|1\.00\d|0\.99\d+) ohm \(assumed\); 0\.003\d to 0\.0\d+ over",
        printed,
    )
    again = load_model(tmp_path / "models/spindle.yaml")
    assert again.assumed["resistance"] == (0.4, 3.0)
    assert again.parameters["resistance"].standing == "assumed"
    assert answer("compare", "latest", "--model", "models/spindle.yaml", "--no-fit")["adequate"] is True


def test_model_set_changes_the_standing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spindle(tmp_path, family=", standing: assumed, range: [0.4 ohm, 3 ohm]")
    monkeypatch.chdir(tmp_path)
    path = "models/spindle.yaml"
    told("model", "set", path, "resistance=1.7 ohm", "--standing", "resistance=measured")
    model = load_model(tmp_path / path)
    assert (model.parameters["resistance"].standing, dict(model.assumed)) == ("measured", {})
    told("model", "set", path, "--standing", "resistance=assumed")
    assert load_model(tmp_path / path).assumed["resistance"] == pytest.approx((0.85, 3.4))
    assert "did you mean 'measured'" in refusal("model", "set", path, "--standing", "resistance=measure")


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        (", standing: assumed, range: [2 ohm, 3 ohm]", "does not contain its value"),
        (", range: [0.5 ohm, 3 ohm]", "has a range, but is not assumed"),
        (", standing: guessed", "standing"),
        (", standing: assumed, range: [0.5 m, 3 m]", "ohm"),
    ],
)
def test_wrong_standings_have_one_message(tmp_path: Path, fields: str, says: str) -> None:
    with pytest.raises(RigctlError, match=says):
        parse_family(FAMILY % fields)
    with pytest.raises(RigctlError, match=says):
        spindle(tmp_path, model=fields)


def test_half_and_twice_zero_is_no_range() -> None:
    text = (FAMILY % "").replace("voltage: {value: 0 V", "voltage: {value: 1 V")
    text = text.replace(
        "{value: 0.01 N*m, bounds: [1e-5 N*m, 1 N*m]}",
        "{value: 0 N*m, bounds: [-1 N*m, 1 N*m], standing: assumed}",
    )
    with pytest.raises(RigctlError, match="half and twice 0 N"):
        parse_family(text)
