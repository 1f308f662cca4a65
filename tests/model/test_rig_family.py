"""The names in a rig file and its family have the same meaning, or the user gets an error."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.families.heater_board.family import FAMILY as HEATER_BOARD
from rigctl.files.shipped import shipped
from rigctl.model import build_system, family_of, input_sources, load_model, parse_model
from rigctl.physics.families import find_family, using_families
from rigctl.rig import Rig, load_rig
from rigctl.rig.load import parse_rig

TANK = "models/families/water-tank.yaml"
RIG = f"""\
name: tank
model: {TANK}
channels:
  level: {{unit: mm, quantity: position}}
actuators:
  inflow: {{kind: level, unit: l/min, low: 0 l/min, high: 5 l/min}}
  heater: {{kind: switch, power: 1 kW}}
geometry: {{base_area: 0.03 m^2}}
constants: {{loss_coefficient: 4 W/K, feed_temperature: 10 degC}}
safe_state: {{inflow: 0 l/min, heater: off}}
"""


def rig(old: str = "", new: str = "") -> Rig:
    assert old in RIG
    return parse_rig(RIG.replace(old, new) if old else RIG, Path("tank.yaml"))


def refused(old: str, new: str) -> str:
    with pytest.raises(RigctlError) as found:
        family_of(rig(old, new))
    return str(found.value)


def test_a_rig_file_may_name_its_family_by_path() -> None:
    assert family_of(rig()).name == "water_tank"
    assert family_of(load_rig(shipped("rigs", "heater-board.yaml"))) is HEATER_BOARD
    with using_families(replace(HEATER_BOARD, name="own_board")):
        assert family_of(rig(TANK, "own_board").model_copy(update={"geometry": {}, "constants": {}}))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (TANK, "watertank", "tank.yaml:2:8: unknown model family, got 'watertank'"),
        (TANK, "nowhere.yaml", "tank.yaml:2:8: there is no such file, got 'nowhere.yaml'"),
        ("base_area:", "bse_area:", "tank.yaml:8:12: unknown constant of water_tank, got 'bse_area'"),
        ("0.03 m^2", "0.03 m", "tank.yaml:8:23: wrong dimension, got '0.03 m'"),
        (
            "4 W/K",
            "-4 W/K",
            "tank.yaml:9:31: loss_coefficient is out of bounds, got '-4 W/K'; expected 0 W/K to",
        ),
        ("10 degC", "10 W", "tank.yaml:9:56: wrong dimension, got '10 W'; expected a temperature"),
        ("unit: mm, quantity: position", "unit: l, quantity: volume", "tank.yaml:4:17"),
    ],
)
def test_mismatches_of_rig_and_family_are_reported_with_their_place(old: str, new: str, said: str) -> None:
    assert said in refused(old, new)


def test_a_rig_without_a_family_is_refused() -> None:
    with pytest.raises(RigctlError, match="names no model family"):
        family_of(rig(f"model: {TANK}\n", "").model_copy(update={"model": None}))


def test_inputs_take_the_power_of_a_switch_and_the_value_of_a_level() -> None:
    family = find_family(TANK)
    sources = {source.input: source for source in input_sources(family, rig())}
    assert sources["heater"].of({"heater": 1.0, "inflow": 0.0}) == 1000.0
    assert sources["inflow"].of({"heater": 0.0, "inflow": 5e-5}) == 5e-5
    assert sources["feed_temperature"].value == pytest.approx(283.15)
    with pytest.raises(RigctlError, match="does not state the power of 'heater'"):
        input_sources(family, rig(", power: 1 kW", ""))
    level = rig().actuators["inflow"].model_copy(update={"unit": "bar"})
    pressed = rig().model_copy(update={"actuators": {**rig().actuators, "inflow": level}})
    with pytest.raises(RigctlError, match="the actuator 'inflow' of the rig 'tank' has another dimension"):
        input_sources(family, pressed)


@pytest.mark.parametrize(("commanded", "wanted"), [("rpm", "Hz"), ("Hz", "rad/s")])
def test_an_actuator_in_rpm_is_refused_for_an_input_in_hz(commanded: str, wanted: str) -> None:
    """1 rpm is 2π/60 rad/s, but 1 Hz may or may not count turns."""
    family = find_family(TANK)
    inputs = tuple(replace(one, unit=wanted) if one.name == "inflow" else one for one in family.inputs)
    level = rig().actuators["inflow"].model_copy(update={"unit": commanded})
    spun = rig().model_copy(update={"actuators": {**rig().actuators, "inflow": level}})
    with pytest.raises(RigctlError, match=f"the model's inflow is in {wanted}, got '{commanded}'"):
        input_sources(replace(family, inputs=inputs), spun)


def test_the_rig_gives_the_parameters_and_selects_the_outputs() -> None:
    system = build_system(family_of(rig()), rig=rig())
    assert system.output_names == ("level",)
    assert dict(zip(system.parameter_names, system.nominal, strict=True))["loss_coefficient"] == 4.0
    assert "33.33333" in repr(system.rhs[0])  # one over the base area, which no fit changes


def test_a_model_file_may_name_its_family_by_path(tmp_path: Path) -> None:
    model = parse_model(
        f"model: {TANK}\nparameters: {{orifice_area: {{value: 12.345678 mm^2, fit: true}}}}\n"
    )
    assert model.family.name == "water_tank"
    assert model.values["orifice_area"] == pytest.approx(12.345678e-6, rel=1e-15)
    assert model.fitted == ("orifice_area",)
    beside = tmp_path / "tank.yaml"
    beside.write_text(shipped(*TANK.split("/")).read_text("utf-8").replace("water_tank", "mine"), "utf-8")
    (tmp_path / "model.yaml").write_text("model: tank.yaml\n", "utf-8")
    assert load_model(tmp_path / "model.yaml").family.name == "mine"
    with pytest.raises(RigctlError, match=r"model\.yaml:1:8: there is no such file"):
        parse_model("model: tonk.yaml\n", tmp_path / "model.yaml")


def test_a_constant_of_the_family_cannot_be_fitted() -> None:
    with pytest.raises(RigctlError, match="base_area is a dimension that no fit changes"):
        parse_model(f"model: {TANK}\nparameters: {{base_area: {{value: 0.1 m^2, fit: true}}}}\n")
