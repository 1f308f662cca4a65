"""The graph of expressions: values, derivatives, dimensions, and error messages."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from rigctl.engine import symbols
from rigctl.engine.symbols import (
    Graph,
    Scalar,
    check_dimension,
    constant_like,
    derivative,
    dimension_of,
    evaluate,
    substitute,
    to_latex,
    to_text,
    variables_of,
)
from rigctl.errors import RigctlError
from rigctl.units import DIMENSIONLESS, Dimension, parse_unit

NAMES = ("x", "y", "z")

Tree: TypeAlias = "str | float | tuple[str, Tree, Tree]"

# smooth everywhere and of bounded growth, so that finite differences are accurate
COMBINE: Mapping[str, Callable[[Scalar, Scalar], Scalar]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / (b * b + 1.5),
    "negative": lambda a, b: -a - (-b),
    "square": lambda a, b: a**2 - b * 0.0 + (a * 1.0) ** 3 * 0.1,
    "tanh": lambda a, b: symbols.tanh(a) + 0.25 * b,
    "sin": lambda a, b: symbols.sin(a) * symbols.cos(b * 0.5),
    "exp": lambda a, b: symbols.exp(symbols.tanh(a)) * b,
    "log": lambda a, b: symbols.log(b * b + 2.0) - a,
    "positive_part": lambda a, b: symbols.positive_part(a, 0.3) * symbols.smooth_step(b, 0.7),
    "maximum": lambda a, b: symbols.maximum(a, b, 0.5) - symbols.minimum(b, a, 0.4),
    "power": lambda a, b: symbols.power(a * a + 1.0, 0.75) * symbols.smooth_sign(b, 0.5),
    "power_of": lambda a, b: symbols.power(a * a + 1.0, symbols.tanh(b)),
}

TREES = st.recursive(
    st.sampled_from([*NAMES, 2.0, -0.5]),
    lambda inner: st.tuples(st.sampled_from(sorted(COMBINE)), inner, inner),
    max_leaves=10,
)
POINTS = st.fixed_dictionaries({name: st.floats(-2.0, 2.0, allow_subnormal=False) for name in NAMES})


def unit(text: str) -> Dimension:
    return parse_unit(text).dimension


def build(tree: Tree, values: Mapping[str, Scalar]) -> Scalar:
    """The formula of `tree`, on expressions or on plain numbers."""
    if isinstance(tree, tuple):
        return COMBINE[tree[0]](build(tree[1], values), build(tree[2], values))
    return values[tree] if isinstance(tree, str) else tree


def variables(graph: Graph) -> dict[str, Scalar]:
    return {name: graph.variable(name, DIMENSIONLESS) for name in NAMES}


@given(TREES, POINTS)
def test_expressions_evaluate_to_the_same_values_as_plain_numbers(
    tree: Tree, point: dict[str, float]
) -> None:
    graph = Graph()
    expr = graph.expression(build(tree, variables(graph)))
    number = float(build(tree, point))
    assert evaluate(expr, point) == pytest.approx(number, rel=1e-12, abs=1e-12)
    assert dimension_of(expr) == DIMENSIONLESS


@given(TREES, POINTS, st.sampled_from(NAMES))
def test_derivative_agrees_with_finite_differences(tree: Tree, point: dict[str, float], name: str) -> None:
    graph = Graph()
    named = variables(graph)
    expr = graph.expression(build(tree, named))
    exact = evaluate(derivative(expr, graph.variables[name]), point)
    h = 1e-3

    def at(offset: float) -> float:
        return evaluate(expr, {**point, name: point[name] + offset})

    # Richardson's fourth- and sixth-order central differences; their difference estimates their error
    d1, d2, d3 = ((at(h * k) - at(-h * k)) / (2 * h * k) for k in (1, 2, 4))
    fourth, coarse = (4 * d1 - d2) / 3, (4 * d2 - d3) / 3
    sixth = (16 * fourth - coarse) / 15
    scale = 1.0 + abs(exact) + abs(at(0.0))
    assume(abs(sixth - fourth) < 1e-6 * scale)
    assert exact == pytest.approx(sixth, abs=1e-5 * scale)


@given(TREES, TREES)
@example(("exp", "x", ("add", -0.5, -0.5)), ("exp", "y", ("add", -0.5, -0.5)))  # the sum of two negatives
def test_equal_formulas_share_one_node(tree: Tree, other: Tree) -> None:
    graph = Graph()
    named = variables(graph)
    first = graph.expression(build(tree, named))
    made = len(graph.nodes)
    assert graph.expression(build(tree, named)) is first
    assert len(graph.nodes) == made
    second = graph.expression(build(other, named))
    assert first + second is second + first


@given(TREES, POINTS)
def test_the_text_of_an_expression_evaluates_to_its_value(tree: Tree, point: dict[str, float]) -> None:
    graph = Graph()
    expr = graph.expression(build(tree, variables(graph)))
    functions = {name: getattr(math, name) for name in ("exp", "log", "sqrt", "tanh", "sin", "cos")}
    number = eval(to_text(expr), {"__builtins__": {}}, {**functions, **point})
    assert number == pytest.approx(evaluate(expr, point), rel=1e-9, abs=1e-9)


@given(TREES, POINTS, st.floats(-2.0, 2.0))
def test_substituting_a_number_agrees_with_evaluating_with_it(
    tree: Tree, point: dict[str, float], x: float
) -> None:
    graph = Graph()
    expr = graph.expression(build(tree, variables(graph)))
    replaced = substitute(expr, {graph.variables["x"]: x})
    assert evaluate(replaced, point) == pytest.approx(evaluate(expr, {**point, "x": x}), rel=1e-9, abs=1e-9)
    assert "x" not in {variable.name for variable in variables_of(replaced)}


def test_derivative_of_a_deep_chain_needs_no_recursion() -> None:
    graph = Graph()
    x = graph.variable("x", DIMENSIONLESS)
    expr = x
    for _ in range(5_000):
        expr = symbols.tanh(expr) + x
    slope = derivative(expr, x)
    assert math.isfinite(evaluate(slope, {"x": 0.1}))
    assert len(pickle.loads(pickle.dumps(slope)).graph.nodes) == len(graph.nodes)
    assert dimension_of(slope) == DIMENSIONLESS
    assert derivative(expr, x) is slope


def test_derivative_is_exactly_zero_where_there_is_no_dependence() -> None:
    graph = Graph()
    x, y = graph.variable("x", unit("m")), graph.variable("y", unit("Pa"))
    slope = derivative(x**2, y)
    assert slope.constant
    assert float(slope) == 0.0
    with pytest.raises(RigctlError, match="with respect to a variable"):
        derivative(x, x * 2)


def test_expressions_are_simplified_to_a_canonical_form() -> None:
    graph = Graph()
    x, y = graph.variable("x", DIMENSIONLESS), graph.variable("y", DIMENSIONLESS)
    assert x + 0 is x
    assert x * 1 is x
    assert +x is x
    assert x - x is graph.constant(0.0)
    assert x / x is graph.constant(1.0)
    assert x * x is x**2
    assert (x**2) ** 3 is x**6
    assert x**0.5 is symbols.sqrt(x)
    assert 2 * (3 * x) is 6 * x
    assert -(x - y) is y - x
    assert (-x) * (-y) is x * y
    assert x - (-y) is x + y
    assert 0 * x is graph.constant(-0.0)
    assert symbols.exp(graph.constant(0.0)) is graph.constant(1.0)


def test_the_dimensions_of_a_hydraulic_term_are_derived_and_checked() -> None:
    graph = Graph()
    area = graph.variable("area", unit("m^2"))
    drop = graph.variable("drop", unit("Pa"))
    density = graph.constant(870.0, unit("kg/m^3"))
    flow = area * symbols.sqrt(2 * symbols.absolute(drop, 1e3) / density)
    assert dimension_of(flow) == unit("m^3/s")
    assert dimension_of(derivative(flow, drop)) == unit("m^3/s/Pa")
    assert dimension_of(drop**1.5) == unit("Pa") ** Fraction(3, 2)
    check_dimension(graph.constant(0.0), unit("m^3/s"), "a switched-off term")
    with pytest.raises(RigctlError, match=r"the leakage has the dimension \[m\^3 s\^-1\].*expected.*\[K\]"):
        check_dimension(flow, unit("K"), "the leakage")


def test_equal_constants_of_different_dimension_are_distinct() -> None:
    graph = Graph()
    length, time = graph.constant(2.0, unit("m")), graph.constant(2.0, unit("s"))
    assert length is not time
    assert dimension_of(length / time) == unit("m/s")
    with pytest.raises(RigctlError, match=r"adds quantities of two dimensions, \[m\] and \[s\]"):
        dimension_of(length + time)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            lambda p, t: p + t,
            r"adds quantities of two dimensions, \[m\^-1 kg s\^-2\] and \[K\], got 'p \+ T'",
        ),
        (lambda p, t: t - 273.15, r"subtracts .* \[K\] and \[1\]"),
        (lambda p, t: symbols.exp(p), r"exp of a quantity with the dimension"),
        (lambda p, t: symbols.tanh(p / t), r"tanh of a quantity.*expected a dimensionless argument"),
        (lambda p, t: symbols.log(t), r"log of a quantity with the dimension \[K\]"),
        (lambda p, t: p**0.7123, "no simple fraction"),
        (lambda p, t: symbols.positive_part(p, t.graph.constant(1.0, t.declared)), "two dimensions"),
    ],
)
def test_a_wrong_dimension_is_refused_with_its_place(
    wrong: Callable[..., symbols.Expr], message: str
) -> None:
    graph = Graph()
    p, t = graph.variable("p", unit("Pa")), graph.variable("T", unit("K"))
    with pytest.raises(RigctlError, match=message):
        dimension_of(wrong(p, t))


@pytest.mark.parametrize(
    "branch",
    [
        lambda x: 1.0 if x > 0 else 0.0,
        lambda x: 1.0 if x else 0.0,
        lambda x: max(x, 0.0),
        lambda x: x == 0,
        abs,
        lambda x: not x,
    ],
)
def test_a_branch_on_a_variable_is_refused_with_the_smooth_alternatives(
    branch: Callable[[symbols.Expr], object],
) -> None:
    x = Graph().variable("velocity", unit("m/s"))
    with pytest.raises(RigctlError, match=r"may not branch.*velocity.*positive_part"):
        branch(x)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda g, x: g.constant(math.nan), "must be finite"),
        (lambda g, x: x * math.inf, "must be finite"),
        (lambda g, x: x / 0.0, "divides by zero"),
        (lambda g, x: g.constant(0.0) ** -1, "divides by zero"),
        (lambda g, x: x + "1", "not part of an equation"),
        (lambda g, x: x + Graph().variable("x", x.declared), "two models"),
        (lambda g, x: g.variable("x", parse_unit("K").dimension), "already has the dimension"),
        (lambda g, x: 2**x, r"exponent of \*\* may not be"),
        (lambda g, x: x**x, r"exponent of \*\* may not be"),
        (lambda g, x: symbols.log(g.constant(-1.0)), "not positive"),
        (lambda g, x: symbols.exp(g.constant(1e4)), "too large"),
        (lambda g, x: g.constant(-8.0) ** (1 / 3), "no real root"),
        (lambda g, x: symbols.positive_part(x, 0.0), "width of a smooth switch"),
        (lambda g, x: float(x), "not a number"),
        (lambda g, x: evaluate(x, {"X": 1.0}), "unknown variable in an equation.*did you mean 'X'"),
    ],
)
def test_mistakes_are_refused_with_a_readable_error(wrong: Callable[..., object], message: str) -> None:
    graph = Graph()
    with pytest.raises(RigctlError, match=message):
        wrong(graph, graph.variable("x", DIMENSIONLESS))


def test_numbers_outside_the_domain_follow_ieee_arithmetic() -> None:
    graph = Graph()
    x = graph.variable("x", DIMENSIONLESS)
    assert evaluate(1.0 / x, {"x": -0.0}) == -math.inf
    assert math.isnan(evaluate(x / x**2 * 0.5, {"x": 0.0}))
    assert math.isnan(symbols.sqrt(-1.0))
    assert math.isnan(symbols.log(-1.0))
    assert math.isnan(symbols.power(-1.0, 0.5))
    assert symbols.log(0.0) == -math.inf
    assert symbols.exp(1e4) == math.inf
    assert symbols.power(0.0, -1.0) == math.inf
    assert symbols.power(1e300, 2.0) == math.inf


def test_smooth_functions_have_their_values_at_corners_and_limits() -> None:
    assert symbols.positive_part(0.0, 0.2) == pytest.approx(0.1)
    assert symbols.positive_part(100.0, 0.2) == pytest.approx(100.0, abs=2e-4)
    assert symbols.positive_part(-100.0, 0.2) == pytest.approx(0.0, abs=2e-4)
    assert symbols.absolute(0.0, 1e-3) == pytest.approx(1e-3)
    assert symbols.maximum(3.0, 5.0, 1e-6) == pytest.approx(5.0)
    assert symbols.minimum(3.0, 5.0, 1e-6) == pytest.approx(3.0)
    assert symbols.smooth_step(0.0, 1.0) == 0.5
    assert symbols.smooth_sign(-50.0, 1.0) == pytest.approx(-1.0)
    assert constant_like(15.0, 2.0) == 15.0


def test_expressions_are_written_as_text_and_latex() -> None:
    graph = Graph()
    k, mu = graph.variable("k", unit("m^3")), graph.variable("mu", unit("Pa*s"))
    a, b = graph.variable("p_a", unit("Pa")), graph.variable("p_b", unit("Pa"))
    leak = k * (a - b) / mu
    assert to_text(leak) == "k*(p_a - p_b)/mu"
    assert to_latex(leak) == r"\frac{k \, \left(p_{\mathrm{a}} - p_{\mathrm{b}}\right)}{\mu}"
    assert to_latex(leak, {"p_a": "p_A"}) == r"\frac{k \, \left(p_A - p_{\mathrm{b}}\right)}{\mu}"
    assert repr(2e-9 * a**-1) == "2e-09*p_a**(-1)"
    assert to_text(a / (b * mu)) == "p_a/(mu*p_b)"
    assert to_latex(symbols.exp(symbols.sqrt(a / b)) * 1e-9) == (
        r"1 \cdot 10^{-9} \, \exp\left(\sqrt{\frac{p_{\mathrm{a}}}{p_{\mathrm{b}}}}\right)"
    )
    assert to_latex(graph.variable("flow_area", unit("m^2"))) == r"\mathrm{flow\_area}"
    assert to_latex(symbols.log(a / b) ** 3) == (r"\ln\left(\frac{p_{\mathrm{a}}}{p_{\mathrm{b}}}\right)^{3}")


def test_a_graph_can_be_pickled() -> None:
    graph = Graph()
    x = graph.variable("x", unit("m"))
    expr = symbols.exp(-(x**2) / constant_like(1.0, x) ** 2)
    copy = pickle.loads(pickle.dumps(expr))
    assert to_text(copy) == to_text(expr)
    assert copy.graph.variable("x", unit("m")) is variables_of(copy)[0]


@pytest.mark.parametrize(
    "function",
    [
        symbols.exp,
        symbols.log,
        symbols.sqrt,
        symbols.tanh,
        lambda x: symbols.power(x, 0.3),
        lambda x: symbols.positive_part(x, 0.1),
    ],
)
def test_functions_take_arrays_element_by_element(function: Callable[[object], object]) -> None:
    points = np.array([-1.0, 0.0, 0.5, 800.0])
    expected = [function(float(point)) for point in points]
    np.testing.assert_allclose(np.asarray(function(points)), expected, rtol=1e-15)
