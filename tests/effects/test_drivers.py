"""The drivers of an effect, from its equations."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.effects.drivers import driver_variables, drivers
from rigctl.effects.registry import find_effect
from rigctl.effects.user import load_effect


@pytest.mark.parametrize(
    ("family", "effect", "expected"),
    [
        ("hydraulic_cylinder", "piston_leakage", ["pressure_a - pressure_b", "oil_temperature"]),
        # the bristle follows the piston's speed
        ("hydraulic_cylinder", "coulomb_friction", ["velocity"]),
        # the pressure of the slot is that of the supply or of either chamber
        ("hydraulic_cylinder", "entrained_air", ["supply_pressure", "pressure_a", "pressure_b"]),
        ("hydraulic_cylinder", "constant_load", []),
        # a lag is driven by its signal, not by the variables that move the signal
        ("hydraulic_cylinder", "pressure_lag", ["supply_pressure"]),
        ("heater_board", "heater_nonlinearity", ["heater_1", "heater_2"]),
        ("oil_viscosity", "walther", ["oil_temperature"]),
    ],
)
def test_drivers_are_the_variables_that_the_terms_depend_on(
    family: str, effect: str, expected: list[str]
) -> None:
    assert [one.name for one in drivers(find_effect(effect, family))] == expected


def test_a_user_effect_has_the_variables_of_its_formula_as_drivers(tmp_path: Path) -> None:
    path = tmp_path / "seal.yaml"
    path.write_text(
        "effect: cold_seal\nsummary: Grips harder in cold oil.\nslot: friction\n"
        "term: force*exp(-(oil_temperature - 20 degC)/decay)*tanh(velocity/(2 mm/s))\n"
        "parameters:\n"
        "  force: {null_value: 0 N, start: 150 N, bounds: [0 N, 2000 N]}\n"
        "  decay: {start: 25 K, bounds: [5 K, 200 K]}\n",
        "utf-8",
    )
    assert driver_variables(load_effect(path)) == {"oil_temperature", "velocity"}
