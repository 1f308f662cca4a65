"""Slots for a family that declares none: at every balance, at every reading and at every input.

An effect can then act wherever physics may be missing, although the family's author declared no slots. With
w the sum of the effects at a slot:

    ``ds/dt = f(...) + w``        at the balance of a state, in its unit per second
    ``z = g(...) + w``            at a reading
    ``u_acting = u + w``          at an input, for the equations of the family; effects are given u
    ``t_acting = t + w``          at an input's switches, in seconds
    ``p_acting = p + w``          at a parameter of a program, whose equations are not seen

The formulas of the family are wrapped, not rewritten, so that they stay what the author wrote. Effects are
given the commanded u because their own laws are functions of the command; given the acting one, the term at
an input would depend on itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import cast

from rigctl.engine.symbols import Expr, Graph, Scalar, variables_of
from rigctl.engine.system import rate_of
from rigctl.errors import RigctlError
from rigctl.foreign.program import Program
from rigctl.physics.family import Formula, InputVariable, ModelFamily, OutputVariable, Slot
from rigctl.physics.scope import Scope
from rigctl.physics.si_unit import si_unit
from rigctl.units import interval_unit, parse_unit


def rate_slot(state: str) -> str:
    """The slot at the balance of `state`."""
    return f"{state}_rate"


def reading_slot(output: str) -> str:
    """The slot at the reading `output`."""
    return f"{output}_reading"


def input_slot(name: str) -> str:
    """The slot at the value of the input `name`."""
    return f"{name}_input"


def delay_slot(name: str) -> str:
    """The slot at the switches of the input `name`."""
    return f"{name}_delay"


def parameter_slot(name: str) -> str:
    """The slot at the parameter `name` of a program."""
    return f"{name}_parameter"


def with_derived_slots(family: ModelFamily) -> ModelFamily:
    """`family` with derived slots if it declares none; else `family` itself.

    A state that is merely the integral of another one (a position) has no balance and gets no slot: a
    position changes only through its speed.
    """
    if family.slots or not family.generic:
        return family
    # The equations tell which inputs act at all, and which states are integrals of others.
    written = rates_in_symbols(family)
    follows = kinematics(family)
    used = {variable.name for expr in written.values() for variable in variables_of(expr)}
    inputs = tuple(item for item in family.inputs if item.name in used)
    balances = tuple(state for state in family.states if state.name not in follows)
    slots = (
        *(
            Slot(rate_slot(state.name), per_second(state.unit), f"at the balance of {state.name}")
            for state in balances
        ),
        *_at_inputs(inputs),
        *_until_acting(item for item in inputs if item.delay is None and family.states),
        *_at_readings(family),
    )
    names = {slot.name for slot in slots}
    acting = frozenset(item.name for item in inputs)
    # Every formula is evaluated with the acting inputs, u + w; a slot of its own is added for the rates of
    # balances and for the readings, none for definitions (they would be seen twice, by what uses them).
    with_slot = {state.name for state in balances}
    return replace(
        family,
        slots=slots,
        states=tuple(
            replace(
                state,
                rate=_Plus(state.rate, rate_slot(state.name) if state.name in with_slot else None, acting),
            )
            for state in family.states
        ),
        definitions=tuple(
            replace(item, formula=_Plus(item.formula, None, acting)) for item in family.definitions
        ),
        outputs=tuple(
            replace(item, formula=_Plus(item.formula, reading_slot(item.name), acting))
            for item in family.outputs
        ),
        inputs=tuple(_delayed(item) if delay_slot(item.name) in names else item for item in family.inputs),
    )


def _shown(item: InputVariable | OutputVariable) -> str:
    return interval_unit(item.shown) if item.shown else ""


def per_second(unit: str) -> str:
    """The SI unit of the time derivative of a quantity with the SI unit `unit`."""
    if unit == "1":
        return "1/s"
    if unit.endswith("/s"):
        return f"{unit}^2"
    return f"{unit}/s" if "/" not in unit else f"({unit})/s"


def rates_in_symbols(family: ModelFamily) -> Mapping[str, Expr]:
    """The rate of every state and the reading of every output (``reading of NAME``), without effects."""
    graph = Graph()
    units = {state.name: state.unit for state in family.states}
    units |= {item.name: item.unit for item in family.inputs}
    units |= {parameter.name: si_unit(parameter.unit) for parameter in family.parameters}
    known: dict[str, Scalar] = {
        name: graph.variable(name, parse_unit(unit).dimension) for name, unit in units.items()
    }
    scope = Scope(family, known)
    rates = {state.name: graph.expression(scope.rate(state.name)) for state in family.states}
    return rates | {
        f"reading of {output.name}": graph.expression(output.formula(scope)) for output in family.outputs
    }


def kinematics(family: ModelFamily) -> dict[str, str]:
    """For each state that is the integral of another one, that other state: of a position, its speed."""
    try:
        written = rates_in_symbols(family)
    except RigctlError:  # an equation of another variant of the family
        return {}
    names = {state.name for state in family.states}
    derivatives = {}
    for state in family.states:
        rate = written[state.name]
        alone = variables_of(rate)
        # dx/dt is the bare variable v: a term there would say that the position changes otherwise than by its
        # speed.
        if rate.op == "variable" and rate.name in names and rate.name != state.name and len(alone) == 1:
            derivatives[state.name] = rate.name
    return derivatives


@dataclass(frozen=True)
class _Plus:
    """A formula of the family, evaluated with the acting inputs, plus the effects at `slot`."""

    formula: Formula
    slot: str | None
    acting: frozenset[str]

    def __call__(self, m: Scope) -> Scalar:
        value = self.formula(cast("Scope", _Acting(m, self.acting)))
        return value if self.slot is None else value + m.total(self.slot)


class _Acting:
    """A scope in which inputs have their acting values, effects included."""

    def __init__(self, scope: Scope, acting: frozenset[str]) -> None:
        self._scope = scope
        self._acting = acting

    def __getitem__(self, name: str) -> Scalar:
        value = self._scope[name]
        return value + self._scope.total(input_slot(name)) if name in self._acting else value

    def __getattr__(self, name: str) -> object:
        if name in self._acting:
            return self[name]
        return getattr(self._scope, name)


def _at_inputs(inputs: Iterable[InputVariable]) -> Iterator[Slot]:
    for one in inputs:
        yield Slot(input_slot(one.name), one.unit, f"beside what {one.name} is", shown=_shown(one))


def _until_acting(inputs: Iterable[InputVariable]) -> Iterator[Slot]:
    for one in inputs:
        yield Slot(delay_slot(one.name), "s", f"until {one.name} acts", kind="command")


def _at_readings(family: ModelFamily) -> Iterator[Slot]:
    for one in family.outputs:
        name, meaning = reading_slot(one.name), f"beside what {one.name} is"
        yield Slot(name, one.unit, meaning, kind="sensor", shown=_shown(one))


def _delayed(item: InputVariable) -> InputVariable:
    return replace(item, delay=_Late(delay_slot(item.name)))


def around(program: Program, family: ModelFamily) -> ModelFamily:
    """`family` with its states computed by `program`, and with slots at its inputs, its readings and the
    program's parameters alone.

    The states are the program's outputs, each with the rate that it has there, and each is read as it is.
    """
    driving = [item for item in family.inputs if item.name in program.inputs]
    given = [one for one in family.parameters if one.name in program.parameters]
    slots = (
        *_at_inputs(driving),
        *_until_acting(driving),
        *_at_readings(family),
        *(
            Slot(
                parameter_slot(one.name),
                si_unit(one.unit),
                f"beside what {one.name} is",
                shown=interval_unit(one.unit),
            )
            for one in given
        ),
    )
    nothing: frozenset[str] = frozenset()
    return replace(
        family,
        states=tuple(replace(one, rate=_Rate(one.name, one.unit)) for one in family.states),
        inputs=tuple(_delayed(item) if item in driving else item for item in family.inputs),
        slots=slots,
        outputs=tuple(
            replace(one, formula=_Plus(_Itself(one.name), reading_slot(one.name), nothing))
            for one in family.outputs
        ),
        program=program,
    )


@dataclass(frozen=True)
class _Itself:
    """The reading of a program's output is the output."""

    name: str

    def __call__(self, m: Scope) -> Scalar:
        return m[self.name]


@dataclass(frozen=True)
class _Rate:
    """The rate of a program's output: a variable that only a simulation knows; 0 in plain numbers."""

    name: str
    unit: str

    def __call__(self, m: Scope) -> Scalar:
        value = m[self.name]
        if isinstance(value, Expr):
            return value.graph.variable(rate_of(self.name), parse_unit(per_second(self.unit)).dimension)
        return 0.0


@dataclass(frozen=True)
class _Late:
    slot: str

    def __call__(self, m: Scope, before: Scalar, after: Scalar) -> Scalar:
        return m.total(self.slot)
