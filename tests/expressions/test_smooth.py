"""The smooth functions of formulas: values, widths, temperatures, and where they are allowed."""

from __future__ import annotations

import math

import pytest

from rigctl.errors import RigctlError
from rigctl.expressions import ValueType, parse, type_of_unit
from rigctl.expressions.functions import ALL_FUNCTIONS
from rigctl.expressions.nodes import Constant, walk
from rigctl.units import parse_unit

TYPES = {"x": type_of_unit("m"), "t": type_of_unit("degC"), "n": type_of_unit("1")}


def value(text: str, **values: float) -> float:
    return float(parse(text, functions=ALL_FUNCTIONS).checked(TYPES).evaluate(values))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("absolute(x, 4 mm)", 5e-3),
        ("positive_part(x, 4 mm)", 4e-3),
        ("positive_part(-x, 4 mm)", 1e-3),
        ("minimum(x, 0 m, 4 mm)", -1e-3),
        ("maximum(x, 0 m, 4 mm)", 4e-3),
        ("smooth_sign(x, 3 mm)", math.tanh(1.0)),
        ("smooth_step(x, 3 mm)", 0.5 * (1.0 + math.tanh(1.0))),
        ("tanh(x/(3 mm))", math.tanh(1.0)),
    ],
)
def test_smooth_functions_have_their_defined_values(text: str, expected: float) -> None:
    assert value(text, x=3e-3) == pytest.approx(expected)


def test_a_width_of_zero_has_no_value() -> None:
    assert math.isnan(value("smooth_step(x, 0 mm)", x=1.0))


def test_a_width_in_degc_is_an_interval() -> None:
    assert value("maximum(t, 20 degC, 3 degC)", t=297.15) == pytest.approx(293.15 + 0.5 * (4.0 + 5.0))
    assert value("smooth_step(t - 20 degC, 2 degC)", t=295.15) == pytest.approx(0.5 * (1 + math.tanh(1.0)))


def test_smooth_functions_keep_their_type_and_step_functions_are_dimensionless() -> None:
    def kind(text: str) -> ValueType:
        return parse(text, functions=ALL_FUNCTIONS).check(TYPES)

    assert kind("absolute(x, 1 mm)") == type_of_unit("m")
    assert kind("maximum(t, 20 degC, 1 K)") == type_of_unit("degC")
    assert kind("smooth_step(x, 1 mm)") == kind("tanh(n)") == type_of_unit("1")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("absolute(x, 1 bar)", "expected a length, as what it rounds"),
        ("absolute(t, t)", "the width of absolute is a temperature"),
        ("minimum(x, 1 bar, 1 mm)", "cannot compare"),
        ("tanh(x)", "cannot take tanh of a length"),
        ("absolute(x)", "absolute takes a value and a width"),
        ("maximum(x, 1 mm)", "maximum takes two values and a width"),
        ("absolute(x < 1 mm, 1 mm)", "cannot take absolute of a condition"),
    ],
)
def test_invalid_arguments_of_smooth_functions_are_refused(text: str, message: str) -> None:
    with pytest.raises(RigctlError) as caught:
        parse(text, functions=ALL_FUNCTIONS).check(TYPES)
    assert message in str(caught.value)


def test_smooth_functions_are_refused_in_conditions() -> None:
    with pytest.raises(RigctlError, match="unknown function"):
        parse("smooth_step(x, 1 mm) > 0.5")


def test_constants_of_a_checked_expression_keep_their_dimension() -> None:
    tree = parse("x/(3 mm) + (t - 20 degC)/(2 K)").checked(TYPES).resolved
    assert tree is not None
    found = [(node.value, node.dimension) for node in walk(tree) if isinstance(node, Constant)]
    metre, kelvin = parse_unit("m").dimension, parse_unit("K").dimension
    assert found == [(pytest.approx(3e-3), metre), (293.15, kelvin), (2.0, kelvin)]
