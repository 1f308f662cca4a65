"""A family of models from two Python functions: ``dx/dt = rates(t, x, u, p)`` and ``y = readings(x, u,
p)``.

The functions are called with symbols in place of numbers, so that what they compute becomes the equations of
the family: with exact derivatives, compiled, with units checked and slots for effects, as if they had been
written in a family file. Arithmetic takes symbols, and so do numpy's functions that have a derivative; a
branch has none, and is refused with the smooth switch to use instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Never, TypeAlias

from rigctl.engine.symbols import Expr, Scalar
from rigctl.errors import RigctlError, unknown_name
from rigctl.physics.derived_slots import with_derived_slots
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


class Variables:
    """Some variables of a model by attribute or by key, ``p.mass`` or ``p["mass"]``, or in order, as
    ``angle, speed = x``."""

    def __init__(self, kind: str, names: Sequence[str], scope: Scope) -> None:
        self._kind, self._names, self._scope = kind, tuple(names), scope

    def __getitem__(self, name: str) -> Scalar:
        if name not in self._names:
            raise unknown_name(self._kind, name, self._names)
        return self._scope[name]

    def __getattr__(self, name: str) -> Scalar:
        if name.startswith("__"):
            raise AttributeError(name)
        return self[name]

    def __iter__(self) -> Iterator[Scalar]:
        return iter([self._scope[name] for name in self._names])


#: what the time is called in messages
_TIME = "the time t"


class _Time:
    """The time of a record, on which no equation may depend: two records begin at other times of day."""

    def __repr__(self) -> str:
        return _TIME

    def _refuse(self, *_: object, **__: object) -> Never:
        raise RigctlError(
            "an equation may not depend on the time itself",
            hint="Make what changes with time an input, or a state with its rate",
        )

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _refuse
    __pow__ = __rpow__ = __neg__ = __pos__ = __abs__ = __float__ = __array_ufunc__ = _refuse
    __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = __bool__ = _refuse
    __hash__ = object.__hash__


def family_from_functions(
    name: str,
    rates: UserFunction | None,
    readings: UserFunction,
    *,
    states: Mapping[str, Declared],
    inputs: Mapping[str, Declared],
    parameters: Mapping[str, Declared],
    outputs: Mapping[str, str],
) -> ModelFamily:
    """The family of two functions, checked; see `rigctl.Model.from_function` for the parameters.

    Raises
    ------
    RigctlError
        a declaration or what a function returns is wrong, a function fails, branches on a symbol or depends
        on the time; or an equation has another dimension than its result.
    """
    if states and rates is None:
        raise RigctlError("there are states, but no function of their rates", expected="rates(t, x, u, p)")
    known = tuple(states), tuple(inputs), tuple(parameters)
    return with_derived_slots(
        check_family(
            ModelFamily(
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
        )
    )


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
        time = (_Time(),) if self.kind == "rate" else ()
        return _called(self.function, (*time, *variables), self.names, self.kind)[self.name]


def _called(
    function: UserFunction, arguments: Sequence[object], names: Sequence[str], kind: str
) -> dict[str, Scalar]:
    """What a user's function returns, by name: a mapping, a sequence in the order declared, or one value."""
    called = getattr(function, "__name__", repr(function))
    try:
        result = function(*arguments)
    except RigctlError as problem:
        if problem.value == _TIME:  # the left operand has refused it first
            arguments[0] + 0.0  # type: ignore[operator]
        raise
    except Exception as problem:  # a user's function may fail in any way
        raise RigctlError(
            f"{called} fails when it is called with symbols: {type(problem).__name__}: {problem}",
            expected="arithmetic and numpy's smooth functions of states, inputs and parameters",
        ) from problem
    if isinstance(result, Mapping):
        found = dict(result)
    elif isinstance(result, Expr | float | int):
        found = dict.fromkeys(names[:1], result) if len(names) == 1 else {}
    else:
        values = list(result) if isinstance(result, Sequence) or hasattr(result, "__array__") else []
        found = dict(zip(names, values, strict=True)) if len(values) == len(names) else {}
    if set(found) != set(names):
        raise RigctlError(
            f"{called} does not return one {kind} for each of {', '.join(names)}",
            value=repr(result),
            expected=f"a dict with these keys, or {len(names)} values in this order",
        )
    return found


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
