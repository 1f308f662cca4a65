"""Arguments of a procedure: their declarations and their values.

In: the section `arguments` of a procedure, and values from the command line or from a step that calls it.
Out: a variable for each argument, of the declared dimension and within its bounds. They are bound before
the procedure is expanded, so that a plan contains only numbers.

A called procedure sees its arguments and nothing else of its caller: it can be read, checked and run by
itself. Bounds and defaults are literals, which depend on no variable.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Protocol, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError, unknown_name
from rigctl.files.refusal import refusal
from rigctl.plan.fields import ProcedurePart, Short, UnitName
from rigctl.plan.values import AnyValue, Value, Variable
from rigctl.units import Quantity, describe, parse_quantity, parse_unit


class ArgumentFields(ProcedurePart):
    """A quantity, or a list of quantities, that a call or the command line may give."""

    description: str = Field(default="", description="its purpose")
    unit: UnitName | None = Field(default=None, description="its dimension; by default that of `default`")
    default: AnyValue | list[AnyValue] | None = Field(
        default=None, description="if left out, a value must be given; a list makes the argument a list"
    )
    low: AnyValue | None = Field(default=None, description="smallest valid value")
    high: AnyValue | None = Field(default=None, description="largest valid value")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        items = self.default if isinstance(self.default, list) else [self.default]
        if self.default is None and self.unit is None:
            raise refusal(RigctlError("an argument needs a unit or a default", expected="e.g. 'unit: bar'"))
        for value in (*items, self.low, self.high):
            if value is not None and value.literal is None:
                raise refusal(
                    RigctlError("an argument's bounds and default have no variables", value=value.text)
                )
        if isinstance(self.default, list) and not self.default:
            raise refusal(RigctlError("an empty list", expected="at least one value"), ("default",))
        return self

    @property
    def is_list(self) -> bool:
        """True if the argument's value is a list."""
        return isinstance(self.default, list)

    @property
    def display_unit(self) -> str:
        """A unit of the argument's dimension."""
        first = self.default[0] if isinstance(self.default, list) else self.default
        if self.unit is not None or first is None or first.literal is None:
            return self.unit or "1"
        return first.literal.unit.text or "1"

    def default_variable(self) -> Variable | None:
        """Return the default as the value of a variable; None if there is none."""
        if isinstance(self.default, list):
            return tuple(value.quantity({}) for value in self.default)
        return None if self.default is None else self.default.quantity({})

    def check(self, value: Quantity) -> None:
        """Refuse a value of another dimension or out of bounds.

        Raises
        ------
        RigctlError
            the dimension is different, or the value is out of bounds.
        """
        unit = parse_unit(self.display_unit)
        if value.unit.dimension != unit.dimension:
            missing = not value.unit.text
            raise RigctlError(
                "the unit is missing" if missing else "wrong dimension",
                value=str(value),
                expected=describe(self.display_unit),
            )
        self._check_bound(value, self.low, sign=-1.0, words="at least")
        self._check_bound(value, self.high, sign=1.0, words="at most")

    def _check_bound(self, value: Quantity, bound: Value | None, *, sign: float, words: str) -> None:
        if bound is not None and sign * (value.si - bound.si({}, self.display_unit)) > 0.0:
            what = "too large" if sign > 0.0 else "too small"
            raise RigctlError(what, value=str(value), expected=f"{words} {bound.text}")


Argument = Annotated[ArgumentFields, Short("default")]


class Declaring(Protocol):
    """A procedure that declares arguments."""

    @property
    def name(self) -> str:
        """The procedure's name."""
        ...

    @property
    def arguments(self) -> Mapping[str, ArgumentFields]:
        """Its arguments by name."""
        ...


def read_arguments(procedure: Declaring, given: Mapping[str, str | float]) -> dict[str, Variable]:
    """Read arguments as typed on a command line: ``30 bar``, or ``20 degC, 40 degC`` for a list.

    Raises
    ------
    RigctlError
        an argument is unknown, or its text is not a quantity.
    """
    variables: dict[str, Variable] = {}
    for name, written in given.items():
        declared = _declared(procedure, name)
        try:
            if declared.is_list:
                parts = [part for part in str(written).strip().strip("[]").split(",") if part.strip()]
                variables[name] = tuple(parse_quantity(part) for part in parts)
            else:
                variables[name] = parse_quantity(written)
        except RigctlError as error:
            error.what = f"argument {name}: {error.what}"
            raise
    return variables


def bind(procedure: Declaring, given: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return every argument of the procedure with its value: the given one, or the default.

    Raises
    ------
    RigctlError
        an argument is unknown, missing, of another dimension, out of bounds, or a list where a single value
        is expected.
    """
    for name in given:
        _declared(procedure, name)
    return {name: _bound(name, argument, given) for name, argument in procedure.arguments.items()}


def _declared(procedure: Declaring, name: str) -> ArgumentFields:
    if name not in procedure.arguments:
        raise unknown_name(f"argument of '{procedure.name}'", name, procedure.arguments)
    return procedure.arguments[name]


def _bound(name: str, argument: ArgumentFields, given: Mapping[str, Variable]) -> Variable:
    value = given.get(name, argument.default_variable())
    try:
        if value is None:
            raise RigctlError("is missing", expected=describe(argument.display_unit))
        if isinstance(value, tuple) and not argument.is_list:
            raise RigctlError("is a list", expected="a single quantity")
        if not isinstance(value, tuple) and argument.is_list:
            value = (value,)
        if value == ():
            raise RigctlError("is an empty list", expected="at least one value")
        for item in value if isinstance(value, tuple) else (value,):
            argument.check(item)
    except RigctlError as error:
        error.what = f"argument {name}: {error.what}"
        raise
    return value
