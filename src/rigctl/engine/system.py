"""A system of equations, which the engine compiles, integrates and differentiates.

In: states, inputs, parameters, equations and delays, collected by `SystemBuilder` from a family and the
effects of a model. Out: a `System`, frozen and checked: all of SI, every name defined, every equation of
the dimension that its left side has. What compiles is thereby consistent.

Equations are expressions of a graph and not Python functions, so that the engine can differentiate them
exactly, find common parts, and emit machine code. A delay is part of the system, not of the commands,
because it may depend on the state at the time of the command.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from rigctl.engine.symbols import Expr, Graph, Scalar, check_dimension, variables_of
from rigctl.errors import RigctlError, unknown_name
from rigctl.foreign.program import Program
from rigctl.units import Dimension, parse_unit

_SECOND = "s"


@dataclass(frozen=True)
class State:
    """A quantity with a derivative. `unit` is the SI one.

    `scale` (same unit) is a relevant change of it: the absolute tolerance of the integration is a fraction of
    it.
    """

    name: str
    unit: str
    scale: float


@dataclass(frozen=True)
class Input:
    """A quantity that is constant between two switches: a valve command, a heater's power, a set-point."""

    name: str
    unit: str


@dataclass(frozen=True)
class Parameter:
    """A quantity that is constant over a record; `value` applies unless the record has another."""

    name: str
    unit: str
    value: float


@dataclass(frozen=True)
class Output:
    """A quantity that is observed: ``z = g(y, u, q)``."""

    name: str
    unit: str
    expr: Expr


@dataclass(frozen=True)
class Delay:
    """The time in seconds from the command of `input` until it acts: ``tau = d(y, u_before, u_after, q)``.

    Evaluated with the state at the time of the command. The commanded values before and after are the
    variables of `before` and `after`. A negative delay counts as 0, as no effect precedes its cause. A later
    command that acts earlier cancels the one still waiting.
    """

    input: str
    expr: Expr


@dataclass(frozen=True)
class Added:
    """What effects add to a parameter of a foreign program, whose sum with it is kept within bounds, SI."""

    parameter: str
    expr: Expr
    low: float
    high: float


@dataclass(frozen=True)
class Foreign:
    """The part of a system that another program computes.

    Its outputs z are states of the system, whose rates are the variables of `rate_of`: what is read of them,
    with every effect on a reading, is in equations. So is what it is given, with every effect on a command.

    Attributes
    ----------
    program: computes z from the drives and from the parameters of these names.
    drives: its inputs, in order, as functions of the system's.
    added: for each of its parameters to which something is added.
    rate_units: SI units of the rates of its outputs.
    """

    program: Program
    drives: tuple[Expr, ...]
    added: tuple[Added, ...]
    rate_units: tuple[str, ...]

    @property
    def responses(self) -> tuple[str, ...]:
        """The states that are its outputs."""
        return tuple(self.program.outputs)


def rate_of(response: str) -> str:
    """The name of the variable for the rate of a foreign program's output."""
    return f"rate of {response}"


def before(input_name: str) -> str:
    """The name of the variable for the input's value before the command, in a `Delay`."""
    return f"{input_name}_before"


def after(input_name: str) -> str:
    """The name of the variable for the input's value after the command, in a `Delay`."""
    return f"{input_name}_after"


@dataclass(frozen=True)
class System:
    """``dy/dt = f(y, u, q)``, ``z = g(y, u, q)``, and the delays of the inputs.

    States y, inputs u (piecewise constant) and parameters q are variables of `graph` of the same names;
    ``rhs[i]`` is the derivative of ``states[i]``.

    Raises
    ------
    RigctlError
        a name is used twice or unknown, a unit is not SI or not its variable's, a scale is not positive, or
        an equation has the wrong dimension or a variable that is none of the system's.
    """

    graph: Graph
    states: tuple[State, ...]
    inputs: tuple[Input, ...]
    parameters: tuple[Parameter, ...]
    rhs: tuple[Expr, ...]
    outputs: tuple[Output, ...]
    delays: tuple[Delay, ...] = ()
    foreign: Foreign | None = None

    def __post_init__(self) -> None:
        _check_names(self)
        _check_units(self)
        _check_equations(self)
        _check_delays(self)

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """The states' names, in order."""
        return tuple(state.name for state in self.states)

    @cached_property
    def input_names(self) -> tuple[str, ...]:
        """The inputs' names, in order."""
        return tuple(item.name for item in self.inputs)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """The parameters' names, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def output_names(self) -> tuple[str, ...]:
        """The outputs' names, in order."""
        return tuple(output.name for output in self.outputs)

    @property
    def nominal(self) -> tuple[float, ...]:
        """The parameters' default values, SI."""
        return tuple(parameter.value for parameter in self.parameters)


class SystemBuilder:
    """Collects the pieces of a `System` by name, in any order.

    >>> builder = SystemBuilder()
    >>> level = builder.state("level", "m", scale=1e-3)
    >>> inflow = builder.input("inflow", "m/s")
    >>> rate = builder.parameter("rate", "1/s", 0.5)
    >>> builder.equation("level", inflow - rate * level)
    >>> builder.output("level_sensor", "m", level)
    >>> builder.build().parameter_names
    ('rate',)
    """

    def __init__(self, graph: Graph | None = None) -> None:
        self.graph = graph or Graph()
        self._states: dict[str, State] = {}
        self._inputs: dict[str, Input] = {}
        self._parameters: dict[str, Parameter] = {}
        self._rhs: dict[str, Expr] = {}
        self._outputs: list[Output] = []
        self._delays: list[Delay] = []
        self._foreign: Foreign | None = None

    def state(self, name: str, unit: str, scale: float) -> Expr:
        """Declare a state; returns its variable."""
        self._states[name] = State(name, unit, scale)
        return self.graph.variable(name, _dimension(unit))

    def input(self, name: str, unit: str) -> Expr:
        """Declare an input; returns its variable."""
        self._inputs[name] = Input(name, unit)
        return self.graph.variable(name, _dimension(unit))

    def parameter(self, name: str, unit: str, value: float) -> Expr:
        """Declare a parameter with its value; returns its variable."""
        self._parameters[name] = Parameter(name, unit, float(value))
        return self.graph.variable(name, _dimension(unit))

    def constant(self, value: float, unit: str) -> Expr:
        """A number of the equations, in the SI unit `unit`."""
        return self.graph.constant(value, _dimension(unit))

    def equation(self, state: str, derivative: Scalar) -> None:
        """Define ``d(state)/dt`` as `derivative`."""
        self._rhs[state] = self.graph.expression(derivative)

    def output(self, name: str, unit: str, expr: Scalar) -> None:
        """Declare an output."""
        self._outputs.append(Output(name, unit, self.graph.expression(expr)))

    def delay(self, input_name: str, expr: Callable[[Expr, Expr], Scalar]) -> None:
        """Delay an input: `expr` depends on the commanded values before and after, and gives seconds.

        Raises
        ------
        RigctlError
            there is no such input.
        """
        if input_name not in self._inputs:
            raise unknown_name("input", input_name, self._inputs)
        dimension = _dimension(self._inputs[input_name].unit)
        old = self.graph.variable(before(input_name), dimension)
        new = self.graph.variable(after(input_name), dimension)
        self._delays.append(Delay(input_name, self.graph.expression(expr(old, new))))

    def foreign(
        self,
        program: Program,
        drives: Sequence[Scalar],
        added: Sequence[Added],
        rate_units: Sequence[str],
    ) -> None:
        """Let another program compute the states that are its outputs."""
        expressions = tuple(self.graph.expression(one) for one in drives)
        self._foreign = Foreign(program, expressions, tuple(added), tuple(rate_units))

    def build(self) -> System:
        """The system, checked.

        Raises
        ------
        RigctlError
            as `System`; or a state has no equation.
        """
        missing = [name for name in self._states if name not in self._rhs]
        if missing:
            raise RigctlError("a state has no equation", value=missing[0], hint="Give its derivative")
        unknown = [name for name in self._rhs if name not in self._states]
        if unknown:
            raise unknown_name("state", unknown[0], self._states)
        return System(
            self.graph,
            tuple(self._states.values()),
            tuple(self._inputs.values()),
            tuple(self._parameters.values()),
            tuple(self._rhs[name] for name in self._states),
            tuple(self._outputs),
            tuple(self._delays),
            self._foreign,
        )


def _dimension(unit: str) -> Dimension:
    return parse_unit(unit).dimension


def _check_names(system: System) -> None:
    if len(system.rhs) != len(system.states):
        raise RigctlError(
            f"{len(system.states)} states have {len(system.rhs)} derivatives", expected="one for each state"
        )
    _no_repeats([*system.state_names, *system.input_names, *system.parameter_names])
    _no_repeats(system.output_names)
    _no_repeats([delay.input for delay in system.delays])


def _no_repeats(names: Sequence[str]) -> None:
    repeated = [name for index, name in enumerate(names) if name in names[:index]]
    if repeated:
        raise RigctlError("a name of the system is used twice", value=repeated[0])


def _check_units(system: System) -> None:
    declared: list[State | Input | Parameter] = [*system.states, *system.inputs, *system.parameters]
    for item in declared:
        unit = parse_unit(item.unit)
        if unit.factor != 1.0 or unit.offset != 0.0:
            raise RigctlError(
                f"{item.name} is not in SI", value=item.unit, expected=f"the SI unit of [{unit.dimension}]"
            )
        variable = system.graph.variables.get(item.name)
        if variable is not None and variable.declared != unit.dimension:
            raise RigctlError(
                f"{item.name} has the dimension [{variable.declared}] in the equations", value=item.unit
            )
    for state in system.states:
        if not state.scale > 0.0:
            raise RigctlError(f"the scale of {state.name} must be positive", value=str(state.scale))


def _check_equations(system: System) -> None:
    # every equation is checked for its variables and its dimension here, once: what compiles is consistent
    known = {*system.state_names, *system.input_names, *system.parameter_names}
    if system.foreign is not None:
        for drive in system.foreign.drives:
            _check_variables(drive, known, f"an input of {system.foreign.program.name}")
        units = {parameter.name: parameter.unit for parameter in system.parameters}
        for one in system.foreign.added:
            what = f"what is added to {one.parameter} of {system.foreign.program.name}"
            _check_variables(one.expr, known, what)
            check_dimension(one.expr, _dimension(units[one.parameter]), what)
        known |= {rate_of(name) for name in system.foreign.responses}
    for state, derivative in zip(system.states, system.rhs, strict=True):
        what = f"the derivative of {state.name}"
        _check_variables(derivative, known, what)
        check_dimension(derivative, _dimension(state.unit) / _dimension(_SECOND), what)
    for output in system.outputs:
        what = f"the output {output.name}"
        _check_variables(output.expr, known, what)
        check_dimension(output.expr, _dimension(output.unit), what)


def _check_delays(system: System) -> None:
    switched = {name for item in system.input_names for name in (before(item), after(item))}
    known = {*system.state_names, *system.parameter_names, *switched}
    for delay in system.delays:
        if delay.input not in system.input_names:
            raise unknown_name("input of a delay", delay.input, system.input_names)
        what = f"the delay of {delay.input}"
        _check_variables(delay.expr, known, what)
        check_dimension(delay.expr, _dimension(_SECOND), what)


def _check_variables(expr: Expr, known: Iterable[str], what: str) -> None:
    names = set(known)
    for variable in variables_of(expr):
        if variable.name not in names:
            raise unknown_name(f"variable in {what}", variable.name, names)
