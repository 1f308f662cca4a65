from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.physics.si_unit import si_unit, si_unit_of
from rigctl.units import Dimension, parse_unit


@pytest.mark.parametrize(
    ("written", "shortest"),
    [
        ("V/A", "ohm"),
        ("N*m/(rad/s)", "J*s"),
        ("kg/s", "kg/s"),
        ("kg/s^2", "N/m"),
        ("W/K", "W/K"),
        ("J/K", "J/K"),
        ("A/V", "1/ohm"),
        ("Pa*s", "Pa*s"),
        ("m^3/s/Pa", "m^3/(Pa*s)"),
        ("m/s", "m/s"),
        ("1/s", "1/s"),
        ("1", "1"),
        ("V*s", "V*s"),
        ("cSt^2", "m^4/s^2"),
    ],
)
def test_a_unit_is_written_with_the_fewest_factors(written: str, shortest: str) -> None:
    assert si_unit_of(parse_unit(written).dimension) == shortest


def test_the_si_unit_of_a_display_unit_is_written_in_the_same_way() -> None:
    """It used to be kg*m^2/(s^2*K), while effects wrote J/K."""
    assert si_unit("kJ/K") == "J/K"
    assert si_unit("bar*min/l") == "Pa*s/m^3"


@given(st.lists(st.integers(-3, 3), min_size=7, max_size=7))
def test_the_written_unit_has_the_same_dimension(exponents: list[int]) -> None:
    dimension = Dimension(tuple(Fraction(one) for one in exponents))
    found = parse_unit(si_unit_of(dimension))
    assert (found.dimension, found.factor, found.offset) == (dimension, 1.0, 0.0)
