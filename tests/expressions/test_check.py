"""Dimensions and temperatures of expressions."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.errors import Location, RigctlError
from rigctl.expressions import BOOLEAN, ValueType, parse, type_of_unit

TYPES = {
    "position": type_of_unit("mm"),
    "pressure": type_of_unit("bar"),
    "valve": type_of_unit("1"),
    "oil": type_of_unit("degC"),
    "room": type_of_unit("K"),
    "spread": type_of_unit("K", difference=True),
    "$target": type_of_unit("degC"),
    "$within": type_of_unit("degC", difference=True),
}

VALUES = {
    "position": 0.05,
    "pressure": 3e6,
    "valve": 1.0,
    "oil": 313.15,
    "room": 293.15,
    "spread": 2.0,
    "$target": 312.15,
    "$within": 0.5,
}


@pytest.mark.parametrize(
    ("text", "unit", "difference"),
    [
        ("position", "mm", False),
        ("position / 2 s", "m/s", False),
        ("pressure * position^2", "N", False),
        ("sqrt(position^2)", "m", False),
        ("abs(-position)", "m", False),
        ("min(position, 3 mm)", "m", False),
        ("valve + 1", "1", False),
        ("oil", "degC", False),
        ("oil - room", "K", True),
        ("oil - $target", "K", True),
        ("oil - $within", "degC", False),
        ("oil - spread", "degC", False),
        ("oil + spread", "degC", False),
        ("spread + oil", "degC", False),
        ("oil + 5 K", "degC", False),
        ("5 K + oil", "degC", False),
        ("oil + 5 degC", "degC", False),
        ("spread - 1 degC", "K", True),
        ("spread + 1 K", "K", True),
        ("1 K + spread", "K", True),
        ("spread - 1 K", "K", True),
        ("2 * spread", "K", True),
        ("spread / 2", "K", True),
        ("-spread", "K", True),
        ("abs(oil - room)", "K", True),
        ("max(oil, 20 degC)", "degC", False),
        ("300 K - oil", "K", True),
        ("oil / room", "1", False),
        ("1 / oil", "1/K", False),
        ("oil^4", "K^4", False),
        ("exp(1000 K / oil)", "1", False),
    ],
)
def test_the_check_gives_the_dimension_and_kind_of_an_expression(
    text: str, unit: str, difference: bool
) -> None:
    assert parse(text).check(TYPES) == type_of_unit(unit, difference=difference)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("oil > 39 degC", True),
        ("oil < 39 degC", False),
        ("39 degC < oil < 41 degC", True),
        ("abs(oil - $target) < 1.5 degC", True),
        ("abs(oil - $target) < 0.5 degC", False),
        ("oil - room < 21 degC", True),
        ("oil - room < 21 K", True),
        ("spread < 3 degC", True),
        ("oil + 1 degC < 42 degC", True),
        ("1 degC + oil > 40.5 degC", True),
        ("oil - 5 K > 30 degC", True),
        ("oil - 300 K < 14 K", True),
        ("oil > 300 K", True),
        ("oil - 20 degC < 21 K", True),
        ("oil < $target + 2 * $within", False),
        ("max(spread, 1 K) < 3 degC", True),
    ],
)
def test_degrees_celsius_are_points_or_differences_depending_on_context(text: str, value: bool) -> None:
    expression = parse(text)
    assert expression.check(TYPES) == BOOLEAN
    assert expression.checked(TYPES).evaluate(VALUES) is value


@pytest.mark.parametrize(
    ("text", "what", "expected"),
    [
        ("position < 1", "cannot compare a length and a plain number", "a length, e.g. '100 mm'"),
        ("position < 1 bar", "cannot compare a length and a pressure", "a length, e.g. '100 mm'"),
        ("1 mm < pressure", "cannot compare a length and a pressure", "a length, e.g. '100 mm'"),
        ("position + 1 bar", "cannot add a length and a pressure", "a length, e.g. '100 mm'"),
        ("position - 1", "cannot subtract a length and a plain number", "a length, e.g. '100 mm'"),
        ("max(position, pressure)", "cannot compare a length and a pressure", "a length, e.g. '100 mm'"),
        ("exp(position)", "cannot take exp of a length", "a plain number"),
        ("log(2 bar)", "cannot take log of a pressure", "a plain number"),
        ("2 ^ position", "an exponent is a plain number, and this is a length", None),
        ("position ^ valve", "the exponent of a length must be a number as written", "between -9 and 9"),
        ("position ^ 99", "the exponent of a length must be a number as written", "between -9 and 9"),
        ("oil + room", "cannot add two temperatures", None),
        ("spread - oil", "cannot subtract a temperature from a difference", None),
        ("oil < spread", "cannot compare a temperature and a temperature difference", None),
        ("spread < $target", "cannot compare a temperature and a temperature difference", None),
        ("2 * oil", "cannot multiply a temperature by a number", None),
        ("oil / 2", "cannot divide a temperature by a number", None),
        ("-oil", "cannot negate a temperature", None),
        ("abs(oil)", "cannot take abs of a temperature", None),
        ("2 * 5 degC", "a temperature in degC cannot be multiplied", "one in K"),
        ("5 degC ^ 2", "a temperature in degC cannot be multiplied", "one in K"),
        ("sqrt(5 degC)", "a temperature in degC cannot be multiplied", "one in K"),
        ("not position", "'not' joins conditions, and this is a length", "a comparison"),
        ("position and valve", "'and' joins conditions, and this is a length", "a comparison"),
        ("(position < 1 mm) + 1", "cannot add a condition", "a value"),
        ("-(position < 1 mm)", "cannot negate a condition", "a value"),
        ("sqrt(valve > 1)", "cannot take sqrt of a condition", "a value"),
        ("(valve > 1) == (valve < 1)", "cannot compare a condition", "a value"),
    ],
)
def test_dimension_mismatches_are_refused(text: str, what: str, expected: str | None) -> None:
    where = Location(Path("p.yaml"), 3, 7)
    with pytest.raises(RigctlError) as caught:
        parse(text, where).check(TYPES)
    assert caught.value.what == what
    assert caught.value.expected == expected
    assert caught.value.where == where
    assert caught.value.value is not None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("positon < 1 mm", "unknown name, got 'positon'; did you mean 'position'?"),
        ("oil < $targt", "unknown variable, got '$targt'; did you mean '$target'?"),
    ],
)
def test_an_unknown_name_is_reported_with_the_nearest(text: str, message: str) -> None:
    with pytest.raises(RigctlError) as caught:
        parse(text).check(TYPES)
    assert str(caught.value) == message


def test_the_expected_type_decides_whether_a_lone_temperature_is_a_difference() -> None:
    lone = parse("0.5 degC")
    difference = type_of_unit("K", difference=True)
    assert lone.checked({}).evaluate({}) == pytest.approx(273.65)
    assert lone.checked({}, expected=difference).evaluate({}) == 0.5
    assert lone.check({}, expected=difference) == difference
    assert parse("0.5 K").check({}, expected=difference) == ValueType(difference.dimension)


@pytest.mark.parametrize(
    ("text", "expected", "message"),
    [
        (
            "position",
            BOOLEAN,
            "this is a length, got 'position'; expected a condition, e.g. 'position < 1 mm'",
        ),
        (
            "position < 1 mm",
            type_of_unit("m"),
            "this is a condition, got 'position < 1 mm'; expected a length",
        ),
        ("pressure", type_of_unit("m"), "this is a pressure, got 'pressure'; expected a length"),
        (
            "oil - room",
            type_of_unit("degC"),
            "this is a temperature difference, got 'oil - room'; expected a temp",
        ),
    ],
)
def test_an_expression_of_another_type_than_expected_is_refused(
    text: str, expected: ValueType, message: str
) -> None:
    with pytest.raises(RigctlError) as caught:
        parse(text).check(TYPES, expected=expected)
    assert str(caught.value).startswith(message)


def test_the_expected_type_is_returned_when_it_fits() -> None:
    assert parse("position < 1 mm").check(TYPES, expected=BOOLEAN) == BOOLEAN
