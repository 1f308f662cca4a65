"""The value of an expression, by name and by row."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.expressions import parse, type_of_unit

ROW = ("position", "pressure", "oil", "valve")
TYPES = {
    "position": type_of_unit("mm"),
    "pressure": type_of_unit("bar"),
    "oil": type_of_unit("degC"),
    "valve": type_of_unit("1"),
}


@pytest.mark.parametrize(
    ("text", "row", "value"),
    [
        ("position < 1 mm", (0.0005, 0, 0, 0), True),
        ("position < 1 mm", (0.001, 0, 0, 0), False),
        ("position <= 1 mm", (0.001, 0, 0, 0), True),
        ("position > 1 mm", (0.002, 0, 0, 0), True),
        ("position >= 1 mm", (0.001, 0, 0, 0), True),
        ("valve == 1", (0, 0, 0, 1.0), True),
        ("valve != 1", (0, 0, 0, 1.0), False),
        ("1 mm < position", (0.002, 0, 0, 0), True),
        ("1 mm < position < 3 mm", (0.002, 0, 0, 0), True),
        ("1 mm < position < 3 mm < position", (0.002, 0, 0, 0), False),
        ("position > 1 mm and pressure > 1 bar", (0.002, 2e5, 0, 0), True),
        ("position > 1 mm and pressure > 1 bar and valve == 1", (0.002, 2e5, 0, 0), False),
        ("position > 1 mm or pressure > 1 bar", (0, 2e5, 0, 0), True),
        ("position > 1 mm or pressure > 1 bar or valve == 1", (0, 0, 0, 1), True),
        ("not position > 1 mm", (0, 0, 0, 0), True),
        ("pressure * position - 1 N/m", (2.0, 3.0, 0, 0), 5.0),
        ("-position", (2.0, 0, 0, 0), -2.0),
        ("max(position, 1 mm)", (2.0, 0, 0, 0), 2.0),
        ("oil - 20 degC", (0, 0, 293.15, 0), 0.0),
        ("3 bar", (0, 0, 0, 0), 3e5),
        ("abs(valve != 0 m / 1 m and valve)", (0, 0, 0, 0), None),
    ],
)
def test_compiled_expressions_give_the_same_value_as_evaluation_by_name(
    text: str, row: tuple[float, ...], value: float | bool | None
) -> None:
    expression = parse(text)
    if value is None:
        with pytest.raises(RigctlError):
            expression.compile(TYPES, ROW)
        return
    compiled = expression.compile(TYPES, ROW)
    assert compiled(row) == pytest.approx(value)
    assert compiled(list(row)) == compiled(row)
    assert expression.checked(TYPES).evaluate(dict(zip(ROW, row, strict=True))) == compiled(row)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 / 0", math.nan),
        ("sqrt(-1)", math.nan),
        ("log(0)", -math.inf),
        ("log(-1)", math.nan),
        ("exp(1e6)", math.inf),
        ("(-1) ^ 0.5", math.nan),
        ("10 ^ 1e6", math.inf),
        ("0 ^ -1", math.nan),
        ("max(1, 1/0)", math.nan),
        ("min(1/0, 1)", math.nan),
    ],
)
def test_undefined_arithmetic_gives_nan_or_infinity_instead_of_an_exception(text: str, value: float) -> None:
    assert parse(text).evaluate({}) == pytest.approx(value, nan_ok=True)


@pytest.mark.parametrize("order", ["<", "<=", ">", ">=", "==", "!="])
@pytest.mark.parametrize("text", ["position {} 1 mm", "1 mm {} position", "2 * position {} position"])
def test_a_missing_value_satisfies_no_comparison(order: str, text: str) -> None:
    assert parse(text.format(order)).compile(TYPES, ROW)((math.nan, 0.0, 0.0, 0.0)) is False


def test_a_name_without_a_value_is_reported() -> None:
    with pytest.raises(RigctlError, match=r"unknown name, got 'positon'; did you mean 'position'\?"):
        parse("positon < 1 mm").evaluate({"position": 1.0})
    with pytest.raises(RigctlError, match="unknown name, got 'oil'"):
        parse("oil > 40 degC").compile(TYPES, ("position",))


def test_degrees_celsius_need_a_check_before_they_are_evaluated() -> None:
    with pytest.raises(ValueError, match="must be checked"):
        parse("oil - room < 1 degC").evaluate({"oil": 300.0, "room": 299.5})


def test_variables_are_passed_with_their_dollar_sign() -> None:
    assert parse("position < $far").evaluate({"position": 1.0, "$far": 2.0}) is True


OPERATORS: dict[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
}


@st.composite
def formulas(draw: st.DrawFn, depth: int = 4) -> tuple[str, Callable[[dict[str, float]], float]]:
    """A formula as text, and the same computed by Python."""
    if depth == 0 or draw(st.booleans()):
        name = draw(st.sampled_from(["a", "b", "number"]))
        if name != "number":
            return name, lambda values: values[name]
        number = draw(st.floats(0, 1e3))
        return f"{number!r}", lambda values: number
    left_text, left = draw(formulas(depth=depth - 1))
    right_text, right = draw(formulas(depth=depth - 1))
    sign = draw(st.sampled_from(sorted(OPERATORS)))
    compute = OPERATORS[sign]
    return f"({left_text} {sign} {right_text})", lambda values: compute(left(values), right(values))


@settings(max_examples=200)
@given(formulas(), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_formulas_evaluate_as_the_same_formulas_in_python(
    formula: tuple[str, Callable[[dict[str, float]], float]], a: float, b: float
) -> None:
    text, compute = formula
    values = {"a": a, "b": b}
    assert parse(text).evaluate(values) == compute(values)
    number = type_of_unit("1")
    assert parse(text).compile({"a": number, "b": number}, ("b", "a"))((b, a)) == compute(values)


@given(st.floats(-50, 150), st.floats(-50, 150))
def test_a_difference_of_temperatures_has_no_offset(oil: float, limit: float) -> None:
    types = {"oil": type_of_unit("degC"), "room": type_of_unit("degC")}
    values = {"oil": oil + 273.15, "room": 293.15}
    difference = values["oil"] - values["room"]
    assert parse(f"oil - room < {limit!r} degC").checked(types).evaluate(values) is (difference < limit)
