"""Valid commands of an actuator."""

from __future__ import annotations

import pytest

from rigctl.errors import RigctlError
from rigctl.rig import Actuator

HEATER = Actuator(kind="switch")
VALVE = Actuator(kind="directional_valve")
RELIEF = Actuator.model_validate({"kind": "level", "unit": "bar", "low": "10 bar", "high": "55 bar"})


@pytest.mark.parametrize(
    ("actuator", "written", "value", "shown"),
    [
        (HEATER, "on", 1.0, "on"),
        (HEATER, 0, 0.0, "off"),
        (HEATER, "1", 1.0, "on"),
        (VALVE, "extend", 1.0, "extend"),
        (VALVE, -1, -1.0, "retract"),
        (VALVE, "neutral", 0.0, "neutral"),
        (RELIEF, "30 bar", 3e6, "30 bar"),
        (RELIEF, "1 MPa", 1e6, "10 bar"),
    ],
)
def test_commands_are_read_into_si_and_shown_in_display_units(
    actuator: Actuator, written: object, value: float, shown: str
) -> None:
    assert actuator.read(written) == value
    assert actuator.show(value) == shown


@pytest.mark.parametrize(
    ("actuator", "written", "message"),
    [
        (HEATER, "onn", "unknown position, got 'onn'; did you mean 'on'?"),
        (HEATER, 2, "no position of this actuator, got '2'; expected off (0), on (1)"),
        (HEATER, "nan", "no position of this actuator, got 'nan'; expected off (0), on (1)"),
        (
            VALVE,
            0.5,
            "no position of this actuator, got '0.5'; expected retract (-1), neutral (0), extend (1)",
        ),
        (RELIEF, "60 bar", "out of range, got '60 bar'; expected 10 bar to 55 bar"),
        (RELIEF, "9 bar", "out of range, got '9 bar'; expected 10 bar to 55 bar"),
        (RELIEF, "30", "the unit is missing, got '30'; expected a pressure, e.g. '30 bar'"),
        (RELIEF, "30 mm", "wrong dimension, got '30 mm'; expected a pressure, e.g. '30 bar'"),
        (RELIEF, "on", "not a quantity, got 'on'; expected a number with its unit, e.g. '30 bar'"),
    ],
)
def test_invalid_commands_are_refused(actuator: Actuator, written: object, message: str) -> None:
    with pytest.raises(RigctlError) as caught:
        actuator.read(written)
    assert str(caught.value) == message
