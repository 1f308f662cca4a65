"""Numbers as a page prints them."""

from __future__ import annotations

import pytest

from rigctl.answers import numbers


@pytest.mark.parametrize(
    ("unit", "printed"),
    [
        ("degC", "°C"),
        ("1", ""),
        ("mm^2", "mm²"),
        ("N*s/m", "N·s/m"),
        ("m^-1", "m⁻¹"),
        ("1/s", "1/s"),
        ("%", "%"),
        ("m^3/s", "m³/s"),
    ],
)
def test_units_are_printed_with_typographic_symbols(unit: str, printed: str) -> None:
    assert numbers.symbol(unit) == printed


@pytest.mark.parametrize(
    ("value", "printed"),
    [
        (77.04, "77.04"),
        (-3.7, "−3.7"),
        (0.0, "0"),
        (None, "–"),
        (float("nan"), "–"),
        (1.2e-7, "1.2·10⁻⁷"),
        (-2.5e9, "−2.5·10⁹"),
        (123456.0, "123500"),
        (1234567.0, "1.235·10⁶"),
    ],
)
def test_numbers_are_printed_with_few_digits_and_powers_of_ten(value: float | None, printed: str) -> None:
    assert numbers.number(value) == printed


def test_an_amount_does_not_break_before_its_unit() -> None:
    assert numbers.amount(40.0, "degC") == "40\N{NO-BREAK SPACE}°C"
    assert numbers.amount(0.5, "1") == "0.5"
    assert numbers.amount(None, "mm") == "–"


@pytest.mark.parametrize(
    ("seconds", "printed"),
    [(0.25, "0.25 s"), (59.0, "59 s"), (61.4, "1 min 01 s"), (3599.9, "1 h 00 min"), (11520.0, "3 h 12 min")],
)
def test_durations_are_printed_in_suitable_units(seconds: float, printed: str) -> None:
    assert numbers.duration(seconds).replace("\N{NO-BREAK SPACE}", " ") == printed


def test_columns_are_aligned() -> None:
    places = numbers.decimals([77.0, 122.64])
    assert [numbers.fixed(value, places) for value in (77.0, 122.64)] == ["77.0", "122.6"]
    assert numbers.fixed(-3.71, 1, sign=True) == "−3.7"
    assert numbers.fixed(0.02, 1, sign=True) == "0.0"
    assert numbers.decimals([]) == 0


def test_a_mean_error_far_below_the_rmse_is_printed_as_zero() -> None:
    assert f"{numbers.resolved(-2.3e-5, 0.14):+.2g}" == f"{numbers.resolved(2.3e-5, 0.14):+.2g}" == "+0"
    assert numbers.resolved(-0.0471, 0.14) == pytest.approx(-0.0476)
    assert numbers.resolved(2.3e-5, 0.0) == 2.3e-5


def test_times_keep_their_zone_and_invalid_texts_are_unchanged() -> None:
    assert numbers.moment("2026-11-21T09:30:00+00:00") == "2026-11-21 09:30:00 UTC"
    assert numbers.moment("soon") == "soon"
    assert numbers.moment(None) == "–"


@pytest.mark.parametrize(
    ("said", "printed"),
    [
        ("rises 2 % from 20 degC to 80 degC", "rises 2 % from 20 °C to 80 °C"),
        ("conductance (6.83 ± 0.06)e-15 m^3 (p < 1e-6)", "conductance (6.83 ± 0.06)·10⁻¹⁵ m³ (p < 10⁻⁶)"),
        ("from 213 to -114 N*s/m", "from 213 to −114 N·s/m"),
        ("20261121-101719-unknown-bench/4", "20261121-101719-unknown-bench/4"),
        ("valve_leakage and heater_1", "valve_leakage and heater_1"),
    ],
)
def test_a_sentence_has_its_units_and_numbers_printed(said: str, printed: str) -> None:
    assert numbers.prose(said) == printed
