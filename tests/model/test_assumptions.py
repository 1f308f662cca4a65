"""Assumptions have the same meaning in imports and analyses: a number without a unit is never SI."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.dataset.assumptions import assumed_values
from rigctl.dataset.run import Run
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.model.measured.assumed import assumed_of, assuming


def both(written: str) -> list[float]:
    """The SI values that an import and an analysis of the shipped board assume."""
    model = load_model(shipped("models") / "heater-board.yaml")
    name, value = written.split("=")
    analysed = assumed_of(assuming(Run(Path(), {}), model, [written]))
    return [assumed_values({name: value}, model.rig, ())[name], analysed[name]]


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("ambient_temperature=21 degC", 294.15),
        ("heater_2=0", 0.0),
        ("heater_2=30 %", 0.3),
        ("heater_2=0.3", 0.3),
    ],
)
def test_import_and_analysis_parse_assumptions_alike(written: str, value: float) -> None:
    assert both(written) == pytest.approx([value, value])


@pytest.mark.parametrize("which", [0, 1], ids=["import", "analysis"])
def test_a_number_without_a_unit_is_not_a_temperature(which: int) -> None:
    model = load_model(shipped("models") / "heater-board.yaml")
    with pytest.raises(RigctlError) as caught:
        if which:
            assuming(Run(Path(), {}), model, ["ambient_temperature=21"])
        else:
            assumed_values({"ambient_temperature": "21"}, model.rig, ())
    assert caught.value.expected == "21 degC"
    assert "ambient_temperature: the unit is missing" in str(caught.value)


def test_a_level_needs_its_unit_and_a_position_none() -> None:
    model = load_model(shipped("models") / "hl32-textbook.yaml")
    rig = model.rig
    assert rig is not None
    level = next(name for name, one in rig.actuators.items() if one.kind == "level")
    switch = next(name for name, one in rig.actuators.items() if one.kind == "switch")
    assert assumed_of(assuming(Run(Path(), {}), model, [f"{switch}=on"])) == {switch: 1.0}
    assert assumed_of(assuming(Run(Path(), {}), model, [f"{switch}=1"])) == {switch: 1.0}
    with pytest.raises(RigctlError, match="the unit is missing") as caught:
        assuming(Run(Path(), {}), model, [f"{level}=30"])
    assert caught.value.expected == f"30 {rig.actuators[level].unit}"


def test_the_unit_suggested_for_an_input_is_that_of_its_actuator() -> None:
    """The relief valve is set in bar: '30' is not to be completed to '30 Pa'."""
    model = load_model(shipped("models") / "hl32-textbook.yaml")
    with pytest.raises(RigctlError, match="pressure_setpoint: the unit is missing") as caught:
        assuming(Run(Path(), {}), model, ["pressure_setpoint=30"])
    assert caught.value.expected == "30 bar"
    assert assumed_of(assuming(Run(Path(), {}), model, ["pressure_setpoint=30 bar"])) == {
        "pressure_setpoint": pytest.approx(3e6)
    }
