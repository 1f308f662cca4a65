"""The grammar: what is read, and what is refused with a clear message."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.errors import Location, RigctlError
from rigctl.expressions import parse
from rigctl.expressions.tokens import MAX_LENGTH
from rigctl.units import parse_quantity

FRAGMENTS = [
    *(
        "a",
        "$b",
        "1",
        "2 mm",
        "3 degC",
        "and",
        "or",
        "not",
        "max",
        "abs",
        "é",
        "1e",
        "°C",
        "0x1",
        "__class__",
    ),
    *"+-*/^()<>=,.%' \t\n",
]


def test_names_and_variables_are_distinguished() -> None:
    expression = parse("abs(oil_temperature - $oil) < 0.5 K and max(position, $far) > 1 mm")
    assert expression.names == {"oil_temperature", "position"}
    assert expression.variables == {"oil", "far"}
    assert not expression.constant
    assert parse("2 * 3 mm").constant


def test_expressions_with_equal_text_are_equal_wherever_they_are() -> None:
    assert parse("position < 1 mm") == parse("position < 1 mm", Location(Path("a"), 3))
    assert hash(parse("a < 1")) == hash(parse("a < 1"))
    assert parse("a < 1") != parse("a < 2")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("-2 ^ 2", -4.0),
        ("(-2) ^ 2", 4.0),
        ("2 ^ 3 ^ 2", 512.0),
        ("2 ^ -1", 0.5),
        ("8 / 4 / 2", 1.0),
        ("8 - 4 - 2", 2.0),
        ("+3", 3.0),
        ("--3", 3.0),
        ("1 < 2 < 3", True),
        ("1 < 3 < 2", False),
        ("not 1 > 2 and 3 > 2", True),
        ("1 > 2 or 2 > 1 and 3 > 4", False),
        ("not (1 > 2 or 2 > 1)", False),
        ("1 == 1", True),
        ("1 != 1", False),
        ("2 >= 2 and 2 <= 2", True),
        ("min(3, 1, 2)", 1.0),
        ("max(3, 1, 2)", 3.0),
        ("sqrt(9) + abs(-1) + exp(0) + log(1)", 5.0),
        ("10 l/min * 60 s", 0.01),
        ("3 mm^2", 3e-6),
        ("100 N*s/m / 1 N", 100.0),
        ("50 %", 0.5),
        ("50%", 0.5),
        ("1e3 mm", 1.0),
        (".5 m + 1. m", 1.5),
        ("1 bar/2", 5e4),
        ("6 bar / 2 bar", 3.0),
        ("-5 degC", 268.15),
    ],
)
def test_literals_and_operators_evaluate_to_the_expected_value(text: str, value: float | bool) -> None:
    assert parse(text).evaluate({}) == pytest.approx(value)


def test_a_unit_ends_where_a_channel_begins() -> None:
    assert parse("10 bar/position").names == {"position"}
    assert parse("10 l/min").names == frozenset()


@pytest.mark.parametrize(
    ("text", "what", "value", "expected"),
    [
        ("", "the expression ends", None, "a number with its unit, a name or '('"),
        ("1 <", "the expression ends after '1 <'", None, "a number with its unit, a name or '('"),
        ("(1", "the expression ends after '(1'", None, "')'"),
        ("1)", "not expected here after '1'", ")", "an operator"),
        ("1 2", "not expected here after '1'", "2", "an operator"),
        ("a b", "not expected here after 'a'", "b", "an operator"),
        ("a = 1", "no operator of this grammar", "=", "'=='"),
        ("a && b", "no operator of this grammar", "&&", "'and'"),
        ("a | b", "no operator of this grammar", "|", "'or'"),
        ("!a", "no operator of this grammar", "!", "'not'"),
        ("a ** 2", "no operator of this grammar", "**", "'^'"),
        ("a ≤ 2", "no operator of this grammar", "≤", "'<='"),
        ("5 foo", "unknown unit", "foo", "a unit such as bar, degC, l/min or N*s/m"),
        ("1e999", "not a finite number", "1e999", None),
        ("max(1)", "max takes two values or more", "1", "max(…)"),
        ("abs(1, 2)", "abs takes one value", "2", "abs(…)"),
        ("a.b", "this has no place in an expression", ".", None),
        ("a[0]", "this has no place in an expression", "[", None),
        ("__import__('os')", "this has no place in an expression", "'", None),
        ("lambda: 1", "this has no place in an expression", ":", None),
        ("$", "this has no place in an expression", "$", None),
    ],
)
def test_invalid_expressions_are_refused_with_message_value_and_location(
    text: str, what: str, value: str | None, expected: str | None
) -> None:
    where = Location(Path("p.yaml"), 3, 7)
    with pytest.raises(RigctlError) as caught:
        parse(text, where)
    assert caught.value.what == what
    assert caught.value.value == value
    assert caught.value.where == where
    if expected is not None:
        assert caught.value.expected == expected


def test_a_misspelt_function_is_reported() -> None:
    with pytest.raises(RigctlError, match=r"unknown function, got 'mox'; did you mean 'max'\?"):
        parse("mox(1, 2)")


def test_a_misspelt_unit_is_reported() -> None:
    with pytest.raises(RigctlError, match="did you mean 'degC'"):
        parse("a > 5 degc")


@pytest.mark.parametrize(
    "text",
    [
        "(" * 40 + "1" + ")" * 40,
        "-" * 40 + "a",
        "not " * 40 + "a > 1",
        "1" + "^1" * 40,
        "abs(" * 40 + "1" + ")" * 40,
    ],
)
def test_nesting_is_limited(text: str) -> None:
    with pytest.raises(RigctlError, match="nested too deep"):
        parse(text)


@pytest.mark.parametrize("text", ["a + " * 200 + "a", "a" * (MAX_LENGTH + 1)])
def test_length_is_limited(text: str) -> None:
    with pytest.raises(RigctlError, match="too long"):
        parse(text)


def test_a_sum_of_125_terms_evaluates() -> None:
    text = "+".join(["1"] * 125)
    assert parse(text).evaluate({}) == 125.0


def test_substitution_replaces_variables_in_the_expression_and_its_text() -> None:
    expression = parse("abs(oil - $oil) < 2*$d and $d^2 > $area/min(1 s, $t)")
    values = {
        "oil": parse_quantity("40 degC"),
        "d": parse_quantity("0.5 K"),
        "area": parse_quantity("3 K^2*s"),
    }
    replaced = expression.substitute(values)
    assert replaced.text == "abs(oil - 40 degC) < 2*0.5 K and (0.5 K)^2 > (3 K^2*s)/min(1 s, $t)"
    assert replaced.variables == {"t"}
    assert replaced.where == expression.where


def test_a_negative_value_keeps_its_sign_in_the_text() -> None:
    replaced = parse("2 - $x").substitute({"x": parse_quantity("-3")})
    assert replaced.text == "2 - (-3)"
    assert replaced.evaluate({}) == 5.0
    assert parse(replaced.text).evaluate({}) == 5.0


@settings(max_examples=500)
@given(
    st.lists(
        st.sampled_from(FRAGMENTS),
        max_size=14,
    )
)
def test_any_text_is_read_or_refused(parts: list[str]) -> None:
    text = " ".join(parts)
    try:
        expression = parse(text)
    except RigctlError as error:
        assert str(error)
    else:
        assert expression.names <= {"a", "e", "x1", "é", "__class__", "max", "abs"}
