"""Raw values to physical ones and back."""

from __future__ import annotations

import math
from datetime import date

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.rig import Channel, parse_rig
from rigctl.rig.calibration import inverse_polynomial, monotonic, polynomial


def channel(**fields: object) -> Channel:
    return Channel.model_validate({"unit": "mm", "quantity": "position", **fields})


TEN_BITS = channel(raw={"bits": 10}, calibration={"coefficients": [-10.0, 300 / 1023]})
THERMOCOUPLE = channel(
    unit="degC",
    quantity="temperature",
    raw={"bits": 12, "low": 0, "high": 4095},
    calibration={"coefficients": [0.0, 0.25]},
)
CURVED = channel(
    raw={"bits": 10, "low": 0.0, "high": 5.0, "unit": "V"}, calibration={"coefficients": [1, 2, 0.5]}
)
FALLING = channel(raw={"bits": 10}, calibration={"coefficients": [300.0, -0.3, -1e-5]})
CHANNELS = [TEN_BITS, THERMOCOUPLE, CURVED, FALLING]


def test_a_10_bit_converter_over_300_mm_resolves_0_29_mm() -> None:
    assert TEN_BITS.resolution == pytest.approx(0.29e-3, rel=0.02)
    assert TEN_BITS.value_from_raw(0) == pytest.approx(-0.010)
    assert TEN_BITS.value_from_raw(1023) == pytest.approx(0.290)


def test_a_thermocouple_resolves_quarters_of_a_degree() -> None:
    assert THERMOCOUPLE.value_from_raw(160) == pytest.approx(313.15)
    assert THERMOCOUPLE.resolution == pytest.approx(0.25)


def test_a_difference_of_temperatures_has_no_offset() -> None:
    spread = channel(unit="degC", quantity="temperature", difference=True)
    assert spread.value_from_raw(5.0) == 5.0


@pytest.mark.parametrize("each", CHANNELS)
@given(share=st.floats(0.0, 1.0))
def test_raw_values_round_trip(each: Channel, share: float) -> None:
    raw = each.converter.low + share * (each.converter.high - each.converter.low)
    assert each.raw_from_value(each.value_from_raw(raw)) == pytest.approx(raw, abs=1e-9 * each.converter.high)


@pytest.mark.parametrize("each", CHANNELS)
@given(value=st.floats(-1e3, 1e3))
def test_quantising_stays_in_range_and_on_the_grid(each: Channel, value: float) -> None:
    raw = each.converter.quantise(each.raw_from_value(value))
    assert each.converter.low <= raw <= each.converter.high * (1 + 1e-12)
    code = (raw - each.converter.low) / each.converter.step
    assert code == pytest.approx(round(code), abs=1e-6)


@given(share=st.floats(0.0, 1.0))
def test_quantising_is_at_most_half_a_step_off(share: float) -> None:
    raw = share * 1023
    assert abs(TEN_BITS.converter.quantise(raw) - raw) <= 0.5 * TEN_BITS.converter.step + 1e-9


def test_a_sensor_beyond_its_range_is_clipped_by_the_converter() -> None:
    assert CURVED.converter.quantise(CURVED.raw_from_value(1.0)) == pytest.approx(5.0)
    assert CURVED.converter.quantise(CURVED.raw_from_value(-1.0)) == 0.0


def test_a_channel_without_a_converter_is_neither_rounded_nor_clipped() -> None:
    speed = channel(unit="rpm", quantity="other", calibration={"coefficients": [5.0, 2.0]})
    assert speed.resolution == 0.0
    assert speed.raw_unit == "rpm"
    assert speed.display.from_si(speed.value_from_raw(1500.25)) == pytest.approx(3005.5)
    assert speed.raw_from_value(speed.value_from_raw(-2e4)) == pytest.approx(-2e4)
    with pytest.raises(RigctlError, match="no converter in the rig file"):
        speed.converter  # noqa: B018


def test_only_finite_values_within_the_range_are_possible() -> None:
    ranged = channel(range=["-5 mm", "300 mm"])
    assert ranged.possible(0.3)
    assert not ranged.possible(0.301)
    assert not ranged.possible(math.nan)
    assert channel().possible(1e9)
    assert not channel().possible(math.nan)


@given(st.lists(st.floats(-10, 10), min_size=1, max_size=5), st.floats(-10, 10))
def test_horners_scheme_equals_the_sum_of_powers(coefficients: list[float], x: float) -> None:
    expected = sum(c * x**k for k, c in enumerate(coefficients))
    assert polynomial(coefficients, x) == pytest.approx(expected, rel=1e-9, abs=1e-6)


def test_a_non_monotonic_curve_cannot_be_inverted() -> None:
    assert monotonic([0, 1, 0.1], 0, 10)
    assert not monotonic([0, -1, 0.1], 0, 10)
    assert not monotonic([1, 0], 0, 10)
    assert inverse_polynomial([0, 0, 0, 1], 8.0, 0.0, 3.0) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ("calibration: {coefficients: [0, 0]}", "coefficients: two raw values give the same reading"),
        (
            "raw: {bits: 10}, calibration: {coefficients: [0, 1, -0.01]}",
            "coefficients: two raw values give the same reading",
        ),
        (
            "calibration: {coefficients: [0, 1, 0.01]}",
            "coefficients: a curved calibration needs the range of its converter",
        ),
        (
            "calibration: {coefficients: [0]}",
            "coefficients: too few entries, got 'a list'; expected at least 2",
        ),
        (
            "calibration: {coefficients: [0, x]}",
            "coefficients: wrong kind of value, got 'x'; expected a number",
        ),
        (
            "calibration: {coefficients: [0, .nan]}",
            "coefficients: wrong kind of value, got '.nan'; expected a finite",
        ),
        ("calibration: {date: 20260301}", "date: no date, got '20260301'; expected a date, e.g. 2026-03-14"),
        (
            "calibration: {date: 2026-02-30}",
            "date: wrong kind of value, got '2026-02-30'; expected a date, e.g.",
        ),
        ("calibration: {uncertainty: 1 bar}", "uncertainty: wrong dimension, got '1 bar'; expected a length"),
        ("calibration: {valid_for: 3 m}", "valid_for: wrong dimension, got '3 m'; expected a time"),
        ("raw: {low: 5, high: 0}", "raw: 'low' is not below 'high'"),
        ("raw: {bits: 0}", "bits: too small, got '0'; expected at least 1"),
        ("raw: {bist: 1}", "unknown field, got 'bist'; did you mean 'bits'?"),
    ],
)
def test_mistakes_in_a_channel_are_reported_with_their_line(field: str, message: str) -> None:
    with pytest.raises(RigctlError) as caught:
        parse_rig(f"name: x\nchannels:\n  a: {{unit: mm, quantity: position, {field}}}\n")
    assert message in str(caught.value)
    assert caught.value.where.line == 3


def test_a_calibration_expires() -> None:
    calibrated = channel(calibration={"date": "2026-03-01", "valid_for": "30 day"}).calibration
    assert calibrated.expires() == date(2026, 3, 31)
    assert channel().calibration.expires() is None
