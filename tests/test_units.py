"""Quantities and units."""

from __future__ import annotations

import math
import subprocess
import sys
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.units import (
    _COMMON,
    _ELECTRICAL,
    _NAMED,
    DIMENSIONLESS,
    SPELLINGS,
    UNITS_OF,
    Dimension,
    convert,
    describe,
    describe_dimension,
    find_unit,
    interval_unit,
    is_angle,
    is_speed_of_rotation,
    known_digits,
    onto_bound,
    parse_quantity,
    parse_unit,
    read_si,
    registry,
    show,
    significant,
    with_uncertainty,
)


@pytest.mark.parametrize(
    ("text", "unit", "si"),
    [
        ("30 bar", "Pa", 3e6),
        ("30bar", "Pa", 3e6),
        ("  30   bar ", "Pa", 3e6),
        ("40 degC", "K", 313.15),
        ("104 degF", "K", 313.15),
        ("40 °C", "K", 313.15),
        ("300 K", "K", 300.0),
        ("14 l/min", "m^3/s", 14e-3 / 60),
        ("120 N*s/m", "kg/s", 120.0),
        ("3.3 mm^2", "m^2", 3.3e-6),
        ("60 cm^3", "m^3", 60e-6),
        ("85.19 cSt", "m^2/s", 85.19e-6),
        ("1500 rpm", "Hz", 1500 * 2 * math.pi / 60),
        ("2e8 Pa*s/m^3", "Pa/(m^3/s)", 2e8),
        ("7e-4 1/K", "K^-1", 7e-4),
        ("50 %", "1", 0.5),
        ("5", "1", 5.0),
        ("-.5 mm", "m", -0.5e-3),
        ("1 day", "s", 86400.0),
        ("1900 J/(kg*K)", "m^2/s^2/K", 1900.0),
        ("2 Nm", "J", 2.0),
        ("3 mN·m", "N*m", 3e-3),
        ("4 1/Nm", "1/(N*m)", 4.0),
        ("1.2 kΩ", "V/A", 1200.0),
        ("5 Ohm", "ohm", 5.0),
        ("6 m³/h", "m^3/s", 6.0 / 3600.0),
        ("7 W/(m²·K)", "kg/s^3/K", 7.0),
        ("60 U/min", "rad/s", 2.0 * math.pi),
        ("60 1/min", "Hz", 1.0),
        ("8 µm", "m", 8e-6),
        ("90 °", "1", 0.5 * math.pi),
        ("2 Ah", "C", 7200.0),
        ("9 s⁻¹", "Hz", 9.0),
        ("25 Celsius", "K", 298.15),
        ("3 count", "1", 3.0),
        ("4 (N*m)/(rad*s)", "W", 4.0),
        ("2 (m/s)^2", "J/kg", 2.0),
        ("6 m**2/s**2", "J/kg", 6.0),
        ("8 1/(1/s)", "s", 8.0),
        ("5 J/degC", "J/K", 5.0),
        ("7 W/(m^2*°C)", "kg/s^3/K", 7.0),
    ],
)
def test_quantities_are_read_into_si(text: str, unit: str, si: float) -> None:
    assert read_si(text, unit) == pytest.approx(si, rel=1e-12)


def test_a_difference_of_temperatures_has_no_offset() -> None:
    assert read_si("0.5 degC", "K", difference=True) == 0.5
    assert read_si("9 degF", "K", difference=True) == pytest.approx(5.0)
    assert convert(10.0, "degC", "degF", difference=True) == pytest.approx(18.0)
    assert show(0.5, "degC", difference=True) == "0.5 K"


@pytest.mark.parametrize(
    ("text", "unit", "message"),
    [
        ("30", "bar", "the unit is missing, got '30'; expected a pressure, e.g. '30 bar'"),
        ("30 mm", "bar", "wrong dimension, got '30 mm'; expected a pressure, e.g. '30 bar'"),
        (
            "30 bra",
            "bar",
            "unknown unit, got 'bra'; expected a unit such as bar, degC, l/min or N*s/m; did you mean 'bar'?",
        ),
        ("bar", "bar", "not a quantity, got 'bar'; expected a number with its unit, e.g. '30 bar'"),
        ("", "bar", "not a quantity, got ''; expected a number with its unit, e.g. '30 bar'"),
        ("1e999 bar", "bar", "not a finite number, got '1e999 bar'"),
        ("1 K", "V", "wrong dimension, got '1 K'; expected a voltage, e.g. '5 V'"),
        ("1 K", "J/kg", "wrong dimension, got '1 K'; expected a quantity in J/kg"),
    ],
)
def test_an_invalid_or_wrong_quantity_is_refused_with_its_message(text: str, unit: str, message: str) -> None:
    with pytest.raises(RigctlError) as caught:
        read_si(text, unit)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    "text",
    [
        "bar^",
        "bar^99",
        "bar^x",
        "(bar",
        "(bar s",
        "(bar 1",
        "bar)",
        "bar//s",
        "*bar",
        "*bar)",
        "s bar)",
        "bar/",
        "bar s",
        "2",
        "a.b",
        "__import__('os')",
        "m" * 99,
        "bar**0.5",
        "()",
        "^2",
        "bar^0",
        "[1]",
        "degC degC",
        "é",
        "1bar",
        "1*degC",  # a point on the scale, or an interval
        "degC^1",
    ],
)
def test_an_unknown_or_malformed_unit_is_refused(text: str) -> None:
    with pytest.raises(RigctlError, match="unknown unit") as caught:
        parse_unit(text)
    if len(text) < 20:
        assert str(caught.value).startswith(f"unknown unit, got {text!r}; expected a unit such as bar")


def test_a_unit_has_at_most_eighty_characters() -> None:
    assert parse_unit("1*" * 39 + "mm").factor == 1e-3
    with pytest.raises(RigctlError, match="unknown unit"):
        parse_unit("1*" * 39 + "(m)")


def test_a_text_is_a_unit_or_none() -> None:
    found = find_unit("bar")
    assert found is not None and found.factor == 1e5
    assert find_unit("bra") is None
    assert (parse_unit("").text, parse_unit("").dimension) == ("", DIMENSIONLESS)
    assert parse_unit("count").dimension == DIMENSIONLESS


def test_a_difference_on_a_scale_is_in_kelvin() -> None:
    assert [interval_unit(unit) for unit in ("degC", "degF", "K", "bar")] == ["K", "K", "K", "bar"]
    assert describe("K") == describe_dimension(parse_unit("K").dimension) == "a temperature, e.g. '40 degC'"
    assert describe("degC", difference=True) == "a temperature difference, e.g. '0.5 K'"
    assert describe("bar", difference=True) == "a pressure, e.g. '30 bar'"
    with pytest.raises(RigctlError, match=r"expected a temperature difference, e\.g\. '0\.5 K'"):
        read_si("3 bar", "degC", difference=True)
    with pytest.raises(RigctlError, match=r"expected a temperature, e\.g\. '40 degC'"):
        read_si("3 bar", "degC")


def test_angles_and_speeds_of_rotation_are_told_from_plain_numbers_and_rates() -> None:
    units = ("rad", "deg", "°", "mrad", "rad/s", "rpm", "deg/s", "U/min", "1/s", "Hz", "1", "%", "m", "rad*m")
    assert [unit for unit in units if is_angle(unit)] == ["rad", "deg", "°", "mrad"]
    assert [unit for unit in units if is_speed_of_rotation(unit)] == ["rad/s", "rpm", "deg/s", "U/min"]


def test_a_quantity_is_shown_as_written_and_read_again() -> None:
    pressure = parse_quantity("30.0 bar")
    assert (str(pressure), pressure.si, read_si(pressure, "Pa")) == ("30 bar", 3e6, 3e6)
    assert str(parse_quantity(5)) == "5"
    assert parse_quantity("40 degC").si == pytest.approx(313.15)
    assert show(123456.0, "bar") == "1.235 bar"
    assert show(1.23456, "1") == significant(1.23456) == "1.235"


@pytest.mark.parametrize("name", [name for name in (*_COMMON, *_ELECTRICAL) if name])
def test_built_in_units_agree_with_pint(name: str) -> None:
    if name in ("1", "count"):
        return
    unit = parse_unit(name)
    pint = registry().Quantity
    text = name.replace("%", "percent")
    assert unit.to_si(1.0) == pytest.approx(pint(1.0, text).to_base_units().magnitude, rel=1e-14)
    assert unit.to_si(0.0) == pytest.approx(pint(0.0, text).to_base_units().magnitude)
    known = {
        f"[{key}]": index for index, key in enumerate(("length", "mass", "time", "current", "temperature"))
    }
    powers = [Fraction(0)] * 7
    for key, power in pint(1.0, text).dimensionality.items():
        powers[known[str(key)]] = Fraction(power)
    assert unit.dimension == Dimension(tuple(powers))


@pytest.mark.parametrize("name", list(_NAMED))
def test_the_example_for_a_named_quantity_has_the_dimension_of_its_unit(name: str) -> None:
    words = describe(name)
    if "e.g." in words:
        example = words.split("'")[1]
        assert parse_quantity(example).unit.dimension == parse_unit(name).dimension


def test_dimensions_multiply_and_print_as_units() -> None:
    pressure, length = parse_unit("Pa").dimension, parse_unit("m").dimension
    assert str(pressure) == "m^-1 kg s^-2"
    assert str(pressure * length**2) == "m kg s^-2"
    assert (length / length).dimensionless
    assert not length.dimensionless
    assert str(DIMENSIONLESS) == "1"
    assert str(length**0.5) == "m^1/2"
    assert describe_dimension(pressure * length**2) == "a force, e.g. '100 N'"
    assert describe_dimension(pressure**2) == "a quantity in m^-2 kg^2 s^-4"


@given(st.floats(-1e9, 1e9), st.sampled_from(["bar", "degC", "degF", "mm", "l/min", "N*s/m", "%", "1"]))
def test_conversion_to_si_and_back_returns_the_value(value: float, name: str) -> None:
    unit = parse_unit(name)
    assert unit.from_si(unit.to_si(value)) == pytest.approx(value, rel=1e-12, abs=1e-9)
    assert unit.from_si(unit.to_si(value, difference=True), difference=True) == pytest.approx(
        value, rel=1e-12
    )


@given(st.floats(-1e9, 1e9), st.sampled_from(["bar", "degC", "K", "mm", "l/min", "1"]))
def test_a_displayed_quantity_is_read_back_unchanged(si: float, unit: str) -> None:
    shown = show(si, unit, digits=17)
    assert read_si(shown, unit) == pytest.approx(si, rel=1e-12, abs=1e-9)


@given(st.text(max_size=20))
def test_any_text_is_read_as_a_quantity_or_refused(text: str) -> None:
    try:
        quantity = parse_quantity(text)
    except RigctlError as error:
        assert str(error)
    else:
        assert math.isfinite(quantity.value)


@given(st.text(alphabet="barmskK*/^()123 -%°CF", max_size=12))
def test_any_text_is_read_as_a_unit_or_refused(text: str) -> None:
    try:
        unit = parse_unit(text)
    except RigctlError:
        return
    assert math.isfinite(unit.factor)
    assert unit.factor != 0.0


def test_conversion_between_different_dimensions_is_refused() -> None:
    assert convert(30.0, "bar", "MPa") == pytest.approx(3.0)
    with pytest.raises(RigctlError, match="cannot convert bar to mm"):
        convert(1.0, "bar", "mm")


def test_common_units_are_read_without_importing_pint() -> None:
    code = (
        "import sys; from rigctl.units import read_si; "
        "[read_si(text, unit) for text, unit in (('30 bar', 'Pa'), ('40 degC', 'K'), ('14 l/min', 'm^3/s'), "
        "('1 day', 's'), ('3 mm^2', 'm^2'), ('120 N*s/m', 'N*s/m'))]; "
        "sys.exit('pint' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_value_off_its_bound_only_by_rounding_is_put_on_the_bound() -> None:
    assert onto_bound(read_si("0.06 l/min", "m^3/s"), 1e-6, 1e-2) == 1e-6
    assert onto_bound(1.0000000000000002e-2, 1e-6, 1e-2) == 1e-2
    for beyond in (1.1e-2, 1e-2 * (1.0 + 1e-9), 1e-6 * (1.0 - 1e-9)):
        assert onto_bound(beyond, 1e-6, 1e-2) == beyond


@pytest.mark.parametrize("quantity", sorted(UNITS_OF))
def test_the_units_listed_for_a_quantity_have_one_dimension(quantity: str) -> None:
    assert len({parse_unit(unit).dimension for unit in UNITS_OF[quantity]}) == 1


@pytest.mark.parametrize("written", ["(degC)", "( °C )"])
def test_a_scale_of_temperature_in_parentheses_keeps_its_offset(written: str) -> None:
    assert parse_unit(written).to_si(20.0) == pytest.approx(293.15)


@pytest.mark.parametrize(("written", "read"), SPELLINGS.items())
def test_alternative_spellings_are_read_as_the_unit_they_stand_for(written: str, read: str) -> None:
    one, other = parse_unit(written), parse_unit(read)
    assert (one.dimension, one.factor, one.offset) == (other.dimension, other.factor, other.offset)


@pytest.mark.parametrize(
    ("written", "nearest"),
    [("BAR", "bar"), ("rmp", "rpm"), ("ohmm", "ohm"), ("kpa", "kPa"), ("percnet", "percent")],
)
def test_an_unknown_unit_is_reported_with_the_nearest_unit(written: str, nearest: str) -> None:
    with pytest.raises(RigctlError, match=f"did you mean '{nearest}'"):
        parse_unit(written)


@pytest.mark.parametrize(
    ("value", "std", "unit", "shown"),
    [
        (0.0002296, 3e-5, "1", "(2.30 ± 0.30)e-04"),
        (0.004631, 0.00017, "l/(min*bar)", "0.00463 ± 0.00017 l/(min*bar)"),
        (4.787, 0.1, "cm^2", "4.79 ± 0.10 cm^2"),
        (1.0324e-14, 1.4e-16, "m^3", "(1.032 ± 0.014)e-14 m^3"),
        (12345.0, 2300.0, "N", "12300 ± 2300 N"),
        (99.96, 0.0996, "K", "99.96 ± 0.10 K"),
        (0.0, 0.021, "mm", "0.000 ± 0.021 mm"),
        (-3.2e7, 2.0e5, "Pa", "(-3.200 ± 0.020)e+07 Pa"),
        (1e-7, 2e-3, "1", "0.0000 ± 0.0020"),
        (3.2e6, 2.0e5, "Pa", "(3.20 ± 0.20)e+06 Pa"),
        (3.2e5, 2.0e4, "Pa", "320000 ± 20000 Pa"),
        (0.0012296, 3e-5, "1", "0.001230 ± 0.000030"),
        (math.inf, 1.0, "1", "inf"),
        (4.05, math.nan, "mm^2", "4.05 mm^2"),
        (4.05123, 0.0, "1", "4.051"),
    ],
)
def test_a_value_has_the_digits_that_its_uncertainty_allows(
    value: float, std: float, unit: str, shown: str
) -> None:
    assert with_uncertainty(value, std, unit) == shown


def test_a_number_below_a_million_is_written_without_a_power_of_ten() -> None:
    """A speed was shown as 2.09e+03 rpm."""
    assert show(219.326, "rpm", digits=3) == "2090 rpm"
    assert show(1e7, "Pa", digits=3) == "1e+07 Pa"
    assert show(120.0, "degC", difference=True, digits=2) == "120 K"
    assert significant(-123456.0, 3, sign=True) == "-123000"
    assert significant(100.4, 2, sign=True) == "+100"
    assert significant(1.5e-5, 2) == "1.5e-05"
    assert significant(999999.0) == "1e+06"
    assert significant(999900.0) == "999900"
    assert significant(-0.0, sign=True) == "+0"
    assert with_uncertainty(48542.0, math.nan, "N") == "48540 N"


@given(st.floats(-1e20, 1e20), st.integers(1, 7))
def test_a_shown_number_has_the_value_of_its_digits(value: float, digits: int) -> None:
    assert float(significant(value, digits)) == float(f"{value:.{digits}g}")


@given(st.floats(-1e20, 1e20), st.floats(1e-20, 1e20))
def test_rounding_to_the_uncertainty_loses_no_significant_digit(value: float, std: float) -> None:
    shown, spread = known_digits(value, std)
    assert abs(float(spread) - std) <= 0.05001 * std
    assert abs(float(shown) - value) <= 0.0501 * std + 1e-12 * abs(value)
