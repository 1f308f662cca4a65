"""``--with EFFECT:param=value``: read with units, checked, and refused with a clear message."""

from __future__ import annotations

import math

import pytest

from rigctl.effects import library
from rigctl.effects.option import read_effect_option
from rigctl.errors import RigctlError


def test_an_effect_name_alone_means_its_typical_size() -> None:
    effect, values = read_effect_option("piston_leakage")
    assert (effect.name, values) == ("piston_leakage", {"conductance": 5.2e-15})


def test_parameters_are_read_with_their_units() -> None:
    effect, values = read_effect_option("stribeck_friction: force=120 N, stribeck_velocity = 2 cm/s")
    assert effect.name == "stribeck_friction"
    assert values == {"force": 120.0, "static_force": 200.0, "stribeck_velocity": 0.02, "presliding": 20e-6}


def test_a_gap_can_be_given_instead_of_a_conductance() -> None:
    _, values = read_effect_option("piston_leakage:clearance=30 um")
    assert values["conductance"] == pytest.approx(math.pi * 0.05 * (30e-6) ** 3 / (12 * 20e-3))
    _, of_a_larger_piston = read_effect_option("piston_leakage:clearance=30 um", parameters={"bore": 0.1})
    assert of_a_larger_piston["conductance"] == pytest.approx(2.0 * values["conductance"])


def test_an_offset_in_degc_is_a_temperature_difference() -> None:
    assert read_effect_option("thermocouple_offset:offset=2 degC")[1] == {"offset": 2.0}


def test_every_effect_can_be_given_by_its_name_alone() -> None:
    for effect in library("hydraulic_cylinder").values():
        if effect.terms:
            assert read_effect_option(effect.name)[1] == effect.start


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("piston_leak", "did you mean 'piston_leakage'"),
        ("coulomb_friction:forse=3 N", "did you mean 'force'"),
        ("piston_leakage:clearence=3 um", "did you mean 'clearance'"),
        ("coulomb_friction:force=3 bar", "expected a force|wrong dimension"),
        ("coulomb_friction:force=3", "coulomb_friction: force: the unit is missing"),
        ("piston_leakage:clearance=30", "piston_leakage: clearance: the unit is missing, got '30'"),
        ("coulomb_friction:force", "expected 'parameter=value'"),
        ("coulomb_friction:force=-3 N", "out of bounds, got '-3 N'; expected 0 N to 20000 N"),
        (
            "piston_leakage:clearance=1 mm",
            "clearance: out of bounds, got '1 mm'; expected what makes the conductance 0 m",
        ),
        ("spool_lag", "base physics"),
    ],
)
def test_mistakes_in_an_option_are_refused_with_a_clear_message(text: str, message: str) -> None:
    with pytest.raises(RigctlError, match=message):
        read_effect_option(text)
