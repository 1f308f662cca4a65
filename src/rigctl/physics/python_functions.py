"""A family of models from two Python functions: ``dx/dt = rates(t, x, u, p)`` and ``y = readings(x, u,
p)``.

The functions are called with symbols in place of numbers, so that what they compute becomes the equations of
the family: with exact derivatives, compiled, with units checked and slots for effects, as if they had been
written in a family file. Arithmetic takes symbols, and so do numpy's functions that have a derivative.

Functions that take none, because they branch, look a table up or call another library, are called with
numbers, by a program that computes the model like an FMU (`rigctl.foreign.functions`): derivatives are
differences, and effects act at the inputs and readings alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias
from uuid import uuid4

import numpy as np

from rigctl.engine.symbols import Scalar
from rigctl.errors import RigctlError
from rigctl.foreign.functions import FunctionProgram
from rigctl.foreign.pool import Job, Pool
from rigctl.foreign.process import PATIENCE
from rigctl.foreign.variables import Time, Variables, by_name, name_of
from rigctl.physics.derived_slots import around, rates_in_symbols, with_derived_slots
from rigctl.physics.family import (
    InputVariable,
    ModelFamily,
    OutputVariable,
    ParameterDeclaration,
    StateVariable,
)
from rigctl.physics.family_checks import check_family
from rigctl.physics.scope import Scope
from rigctl.physics.si_unit import si_unit
from rigctl.units import Quantity, parse_quantity, parse_unit, read_si

#: a quantity alone, or with what goes with it
Declared: TypeAlias = str | float | Sequence[str | float]
#: a user's function of the time, and of states, inputs and parameters by name
UserFunction: TypeAlias = Callable[..., Any]

#: change of a state that matters where the user states none, in the unit in which its start is written
_SCALE = 1e-3
#: duration of the simulation by which functions are tried, s
_FIRST = 1e-6


def family_from_functions(
    name: str,
    rates: UserFunction | None,
    readings: UserFunction,
    *,
    states: Mapping[str, Declared],
    inputs: Mapping[str, Declared],
    parameters: Mapping[str, Declared],
    outputs: Mapping[str, str],
    time_limit: float = PATIENCE,
) -> ModelFamily:
    """The family of two functions, checked; see `rigctl.Model.from_function` for the parameters.

    Raises
    ------
    RigctlError
        a declaration or what a function returns is wrong, a function fails or depends on the time; or an
        equation has another dimension than its result.
    """
    if states and rates is None:
        raise RigctlError("there are states, but no function of their rates", expected="rates(t, x, u, p)")
    known = tuple(states), tuple(inputs), tuple(parameters)
    family = ModelFamily(
        name=name,
        title=name.replace("_", " "),
        source=getattr(readings, "__module__", ""),
        states=tuple(
            _state(one, written, _Formula(rates or readings, "rate", one, tuple(states), *known))
            for one, written in states.items()
        ),
        inputs=tuple(_input(one, written) for one, written in inputs.items()),
        parameters=tuple(_parameter(one, written) for one, written in parameters.items()),
        definitions=(),
        slots=(),
        outputs=tuple(
            OutputVariable(
                one,
                si_unit(_unit_of(one, unit)),
                _Formula(readings, "reading", one, tuple(outputs), *known),
                "",
                shown=unit,
            )
            for one, unit in outputs.items()
        ),
    )
    why = _no_symbols(family)
    if why is not None:
        return _called_with_numbers(family, rates, readings, why, time_limit)
    return with_derived_slots(check_family(family))


def _no_symbols(family: ModelFamily) -> RigctlError | None:
    """Why the functions take no symbols; None if they do."""
    try:
        rates_in_symbols(family)
    except RigctlError as problem:
        return problem
    return None


def _called_with_numbers(
    family: ModelFamily, rates: UserFunction | None, readings: UserFunction, why: RigctlError, limit: float
) -> ModelFamily:
    """The family whose functions take no symbols, as `why` says: they are its program.

    Raises
    ------
    RigctlError
        they cannot be sent to another process, or fail with numbers too.
    """
    starts = {one.name: (one.start, one.scale) for one in family.states}
    units = {one.name: parse_unit(one.unit).dimension for one in family.states}
    free = [one for one in family.parameters if not one.fixed]
    program = FunctionProgram(
        name=family.name,
        token=uuid4().hex,
        code=_sent(rates, readings),
        why=f"they take no symbols ({_clause(why)})",
        states=starts,
        inputs=tuple(one.name for one in family.inputs),
        outputs=tuple(one.name for one in family.outputs),
        parameters=tuple(one.name for one in free),
        sizes={one.name: abs(one.value) or 0.01 * (one.high - one.low) for one in free},
        settable=tuple(
            one.name for one in family.outputs if units.get(one.name) == parse_unit(one.unit).dimension
        ),
        constants={one.name: one.value for one in family.parameters if one.fixed},
        patience=limit,
    )
    first = _first_readings(program, family, why)
    observed = tuple(
        StateVariable(
            one.name,
            one.unit,
            starts[one.name][1] if one.name in program.settable else _SCALE * parse_unit(one.shown).factor,
            one.formula,  # until `around`
            starts[one.name][0] if one.name in program.settable else value,
            "",
            _difference(one.shown),
        )
        for one, value in zip(family.outputs, first, strict=True)
    )
    return check_family(around(program, replace(family, states=observed)))


def _clause(why: RigctlError) -> str:
    return why.what + (f": {why.value}" if why.value else "")


def _sent(rates: UserFunction | None, readings: UserFunction) -> bytes:
    import cloudpickle

    try:
        sent: bytes = cloudpickle.dumps((rates, readings))
    except Exception as problem:  # whatever an object that the functions use refuses
        raise RigctlError(
            "the functions cannot be sent to the process that calls them with numbers",
            value=f"{type(problem).__name__}: {problem}",
            hint="Make what they use when they are called, or a part of their own module",
        ) from problem
    return sent


def _first_readings(program: FunctionProgram, family: ModelFamily, why: RigctlError) -> list[float]:
    """What the sensors read at the start, by which the functions are tried.

    Raises
    ------
    RigctlError
        a function fails with numbers as well as with symbols.
    """
    values = {one.name: one.value for one in family.parameters}
    pool = Pool(program, 1)
    try:
        tried = pool.once(
            Job(
                "the start",
                np.array([0.0, _FIRST]),
                np.array([[one.value for one in family.inputs]]),
                np.array([values[name] for name in program.parameters]),
                np.full(len(program.outputs), np.nan),
            )
        )
    finally:
        pool.close()
    if tried.reason:
        raise RigctlError(tried.reason, hint=f"With symbols: {_clause(why)}")
    return [float(value) for value in tried.values[0]]


@dataclass(frozen=True)
class _Formula:
    """One value that a user's function returns, as a formula of a scope.

    Attributes
    ----------
    function: the user's; of rates, it has the time as its first argument.
    kind: "rate" or "reading".
    name: of the state or output; `names` are all of them, in the order declared.
    states, inputs, parameters: those of the family.
    """

    function: UserFunction
    kind: Literal["rate", "reading"]
    name: str
    names: tuple[str, ...]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]

    def __call__(self, m: Scope) -> Scalar:
        """Its value in `m`."""
        variables = (
            Variables("state", self.states, m),
            Variables("input", self.inputs, m),
            Variables("parameter", self.parameters, m),
        )
        # Each state's rate is a formula of its own, so the function is called once per state, and one of its
        # values is taken; a common subexpression is one node of the graph all the same.
        time = (Time(),) if self.kind == "rate" else ()
        return _called(self.function, (*time, *variables), self.names, self.kind)[self.name]


def _called(
    function: UserFunction, arguments: Sequence[object], names: Sequence[str], kind: str
) -> dict[str, Scalar]:
    """What a user's function returns for symbols, by name."""
    called = name_of(function)
    try:
        result = function(*arguments)
    except RigctlError as problem:
        if problem.value == repr(arguments[0]):  # the left operand has refused the time first
            arguments[0] + 0.0  # type: ignore[operator]
        raise
    except Exception as problem:  # a user's function may fail in any way
        raise RigctlError(
            f"{called} fails when it is called with symbols: {type(problem).__name__}: {problem}",
            expected="arithmetic and numpy's smooth functions of states, inputs and parameters",
        ) from problem
    return by_name(called, result, names, kind)


def _split(name: str, written: Declared, most: int, expected: str) -> tuple[Quantity, tuple[Any, ...]]:
    """A quantity, and what was declared beside it."""
    alone = isinstance(written, str | float | int)
    parts = [written] if alone else list(written) if isinstance(written, Sequence) else []
    if not parts:
        raise RigctlError(f"'{name}' is declared without a quantity", value=repr(written), expected=expected)
    first, *rest = parts
    if len(rest) > most:
        raise RigctlError(f"'{name}' is declared with too much", value=repr(written), expected=expected)
    try:
        return parse_quantity(first), tuple(rest)  # type: ignore[arg-type]
    except RigctlError as problem:
        raise RigctlError(f"'{name}': {problem.what}", value=str(first), expected=expected) from problem


def _unit_of(name: str, written: str) -> str:
    if not isinstance(written, str):
        raise RigctlError(f"'{name}' has no unit", value=repr(written), expected='e.g. "rad/s", or "1"')
    return written


def _state(name: str, written: Declared, rate: Callable[[Scope], Scalar]) -> StateVariable:
    start, scale = _split(name, written, 1, 'its start, e.g. "0 rad/s", or ("0 rad/s", "0.01 rad/s")')
    unit = start.unit.text or "1"
    matters = read_si(scale[0], unit, difference=True) if scale else _SCALE * start.unit.factor
    if not matters > 0.0:
        raise RigctlError(f"'{name}': the change that matters must be greater than zero", value=str(scale[0]))
    return StateVariable(name, si_unit(unit), matters, rate, start.si, "", _difference(unit))


def _input(name: str, written: Declared) -> InputVariable:
    value, _ = _split(name, written, 0, 'its value when nothing is commanded, e.g. "0 V"')
    unit = value.unit.text or "1"
    return InputVariable(name, si_unit(unit), value.si, "", difference=_difference(unit), shown=unit)


def _parameter(name: str, written: Declared) -> ParameterDeclaration:
    wanted = 'a number, e.g. "9.81 m/s^2", or one to fit with its bounds: ("2 ohm", "0.1 ohm", "50 ohm")'
    value, bounds = _split(name, written, 2, wanted)
    unit = value.unit.text or "1"
    if not bounds:
        return ParameterDeclaration(name, unit, value.si, "", low=-float("inf"), fixed=True)
    if len(bounds) == 1:
        raise RigctlError(f"'{name}' has one bound", value=repr(written), expected=wanted)
    low, high = (read_si(end, unit) for end in bounds)
    if not low <= value.si <= high or low == high:
        raise RigctlError(
            f"'{name}' is not between its bounds", value=str(value), expected=f"{bounds[0]} to {bounds[1]}"
        )
    return ParameterDeclaration(name, unit, value.si, "", low, high)


def _difference(unit: str) -> bool:
    return not parse_unit(unit).absolute_temperature
