"""Requirements on a system of equations, and the errors if they are not met."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rigctl.engine.symbols import Graph, sqrt
from rigctl.engine.system import Delay, Input, Output, Parameter, State, System, SystemBuilder
from rigctl.errors import RigctlError
from rigctl.units import parse_unit


def tank() -> tuple[SystemBuilder, dict[str, object]]:
    """A tank that drains through a hole."""
    builder = SystemBuilder()
    names = {
        "level": builder.state("level", "m", scale=1e-3),
        "inflow": builder.input("inflow", "m^3/s"),
        "area": builder.parameter("area", "m^2", 0.5),
        "hole": builder.parameter("hole", "m^2", 1e-4),
    }
    gravity = builder.constant(9.81, "m/s^2")
    outflow = names["hole"] * sqrt(2 * gravity * names["level"])
    builder.equation("level", (names["inflow"] - outflow) / names["area"])
    builder.output("level", "m", names["level"])
    builder.output("outflow", "m^3/s", outflow)
    return builder, names


def test_a_system_knows_its_names_and_values() -> None:
    system = tank()[0].build()
    assert system.state_names == ("level",)
    assert system.input_names == ("inflow",)
    assert system.parameter_names == ("area", "hole")
    assert system.output_names == ("level", "outflow")
    assert system.nominal == (0.5, 1e-4)
    with pytest.raises(AttributeError):
        system.states = ()  # type: ignore[misc]


def wrong_rhs(builder: SystemBuilder, names: dict[str, object]) -> None:
    builder.equation("level", names["inflow"])  # type: ignore[arg-type]


def foreign_variable(builder: SystemBuilder, names: dict[str, object]) -> None:
    unknown = builder.graph.variable("levle", parse_unit("m/s").dimension)
    builder.equation("level", unknown)


def wrong_output(builder: SystemBuilder, names: dict[str, object]) -> None:
    builder.output("speed", "m/s", names["level"])  # type: ignore[arg-type]


def twice(builder: SystemBuilder, names: dict[str, object]) -> None:
    builder.output("level", "m", names["level"])  # type: ignore[arg-type]


def delay_in_metres(builder: SystemBuilder, names: dict[str, object]) -> None:
    builder.delay("inflow", lambda before, after: names["level"])  # type: ignore[arg-type,return-value]


def delay_on_present_input(builder: SystemBuilder, names: dict[str, object]) -> None:
    per_flow = builder.constant(1.0, "s^2/m^3")
    builder.delay("inflow", lambda before, after: per_flow * names["inflow"])  # type: ignore[operator]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (wrong_rhs, r"the derivative of level has the dimension \[m\^3 s\^-1\].*expected.*\[m s\^-1\]"),
        (foreign_variable, "unknown variable in the derivative of level, got 'levle'.*'level'"),
        (wrong_output, r"the output speed has the dimension \[m\]"),
        (twice, "used twice, got 'level'"),
        (delay_in_metres, r"the delay of inflow has the dimension \[m\].*expected the dimension \[s\]"),
        (delay_on_present_input, "unknown variable in the delay of inflow, got 'inflow'"),
        (lambda b, n: b.state("other", "K", scale=1.0), "a state has no equation, got 'other'"),
        (lambda b, n: b.equation("lvel", n["level"]), "unknown state, got 'lvel'.*'level'"),
        (lambda b, n: b.parameter("inflow", "m^3/s", 1.0), "used twice, got 'inflow'"),
        (lambda b, n: b.delay("inflw", lambda x, y: x), "unknown input, got 'inflw'"),
        (lambda b, n: b.parameter("area", "m", 1.0), "already has the dimension"),
        (lambda b, n: b.parameter("p", "bar", 1.0), "p is not in SI, got 'bar'"),
        (lambda b, n: b.input("t", "degC"), "t is not in SI"),
    ],
)
def test_mistakes_are_refused_with_the_wrong_name(
    spoil: Callable[[SystemBuilder, dict[str, object]], object], message: str
) -> None:
    builder, names = tank()
    with pytest.raises(RigctlError, match=message):
        spoil(builder, names)
        builder.build()


def test_a_system_built_directly_is_checked_too() -> None:
    graph = Graph()
    x = graph.variable("x", parse_unit("m").dimension)
    rhs = x / graph.constant(1.0, parse_unit("s").dimension)
    state = State("x", "m", 1.0)
    good = System(graph, (state,), (), (), (rhs,), (Output("x", "m", x),))
    assert good.delays == ()
    with pytest.raises(RigctlError, match="1 states have 2 derivatives"):
        System(graph, (state,), (), (), (rhs, rhs), ())
    assert System(graph, (), (), (), (), ()).state_names == ()
    with pytest.raises(RigctlError, match="the scale of x must be positive"):
        System(graph, (State("x", "m", 0.0),), (), (), (rhs,), ())
    with pytest.raises(RigctlError, match=r"x has the dimension \[m\] in the equations, got 's'"):
        System(graph, (State("x", "s", 1.0),), (), (), (rhs,), ())
    with pytest.raises(RigctlError, match="unknown input of a delay"):
        System(graph, (state,), (), (), (rhs,), (), (Delay("u", x),))
    with pytest.raises(RigctlError, match="used twice"):
        System(graph, (state,), (Input("x", "m"),), (Parameter("k", "1", 0.0),), (rhs,), ())
