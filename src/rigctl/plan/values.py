"""Quantities of a procedure: literals with a unit, or expressions of ``$variables``.

A field declares by its `Kind` what it accepts. Literals are checked when the file is read, so that a
mistake is found in a file of which no plan is made; values with variables, or of a dimension that only
the rig knows, when the plan is made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from rigctl.errors import RigctlError, unknown_name
from rigctl.expressions import Expression, parse, type_of_unit
from rigctl.files.quantity import quantity_text, reader_schema
from rigctl.rig.rates import FASTEST
from rigctl.units import Quantity, describe, parse_quantity, parse_unit

#: the value of ``$name``: a quantity, or a list of quantities for a sweep
Variable: TypeAlias = Quantity | tuple[Quantity, ...]
Variables: TypeAlias = Mapping[str, Variable]

MARK = "$"


@dataclass(frozen=True, slots=True)
class Kind:
    """What a field accepts: a dimension, and bounds in SI, which are inclusive unless stated otherwise.

    `unit` is any unit of the dimension; None if the dimension depends on the rig, and is given by the caller
    that resolves the value. With `difference`, a temperature is an interval.
    """

    unit: str | None
    difference: bool = False
    at_least: float | None = None
    more_than: float | None = None
    at_most: float | None = None
    whole: bool = False
    examples: tuple[str, ...] = ()

    def read(self, written: object) -> Value:
        """Return the value in the file, checked as far as possible without a rig.

        Raises
        ------
        RigctlError
            the value is neither a quantity nor a valid formula, has a wrong dimension, or is out of bounds.
        """
        if isinstance(written, Value):
            return written
        text = quantity_text(written, self.expected())
        if MARK in text:
            return Value(text, self, None, parse(text))
        value = Value(text, self, parse_quantity(text), None)
        if self.unit is not None:
            value.si({})
        return value

    def expected(self) -> str:
        """A description of the expected form, for error messages."""
        if self.whole:
            return "a whole number"
        return "a number with its unit, e.g. '30 bar'" if self.unit is None else self._described(self.unit)

    def _described(self, unit: str) -> str:
        return describe(unit, difference=self.difference)

    def check(self, si: float, text: str) -> float:
        """Return an SI value; refuse one out of bounds, or a fraction where a whole number is required."""
        if self.whole and si != int(si):
            raise RigctlError("not a whole number", value=text, expected="a whole number")
        if self.more_than is not None and si <= self.more_than:
            bound = "zero" if self.more_than == 0.0 else f"{self.more_than:g}"
            raise RigctlError("too small", value=text, expected=f"more than {bound}")
        if self.at_least is not None and si < self.at_least:
            raise RigctlError("too small", value=text, expected=f"at least {self.at_least:g}")
        if self.at_most is not None and si > self.at_most:
            unit = f" {self.unit}" if self.unit not in (None, "1") else ""
            raise RigctlError("too large", value=text, expected=f"at most {self.at_most:g}{unit}")
        return si

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read with `read`; a RigctlError becomes an error of the field."""
        return reader_schema(self.read)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe a text with a number and a unit, or with variables; also a plain number if valid."""
        plain = self.unit in (None, "1")
        examples = self.examples or _EXAMPLES.get(self.unit or "", ("30 bar",))
        return {
            "type": ["string", "number"] if plain else "string",
            "pattern": r"\$|^\s*[+-]?(\d|\.\d)",
            "examples": list(examples),
            "description": f"{self.expected().partition(', e.g.')[0]}, or an expression of $variables",
        }


_EXAMPLES: Mapping[str, tuple[str, ...]] = {
    "s": ("2 s", "10 min", "2 h"),
    "K": ("40 degC", "313.15 K"),
    "Pa": ("30 bar", "5 MPa"),
    "m": ("100 mm",),
    "Hz": ("100 Hz",),
    "1": ("3", "$count"),
}


@dataclass(frozen=True, slots=True)
class Value:
    """A quantity as written: a literal, or an expression with ``$variables``."""

    text: str
    kind: Kind
    literal: Quantity | None
    expression: Expression | None

    def si(self, variables: Variables, unit: str | None = None, *, difference: bool | None = None) -> float:
        """Return the value in SI, checked against its kind.

        Parameters
        ----------
        variables: values of the ``$names``.
        unit: any unit of the required dimension, if the kind leaves it open.
        difference: whether it is a temperature interval, if the kind leaves that open.

        Raises
        ------
        RigctlError
            a variable is unknown, the dimension is a different one, or the value is out of bounds.
        """
        wanted = unit or self.kind.unit
        if wanted is None:
            raise ValueError("a value of open dimension needs a unit to be resolved")
        interval = self.kind.difference if difference is None else difference
        quantity = self.literal or self._simple(variables)
        if quantity is None:
            si = self._evaluate(variables, wanted, interval)
        else:
            si = _in_dimension(quantity, wanted, interval, self._shown(quantity))
        return self.kind.check(si, self.text if quantity is None else self._shown(quantity))

    def quantity(self, variables: Variables) -> Quantity:
        """Return the value with a unit for display: the written one, or that of the first variable in its
        expression."""
        known = self.literal or self._simple(variables)
        if known is not None:
            return known
        first = _scalar(variables, min(self._names(), key=self.text.index))
        si = self._evaluate(variables, first.unit.text or "1", self.kind.difference)
        return Quantity(first.unit.from_si(si), first.unit)

    def _names(self) -> frozenset[str]:
        return self.expression.variables if self.expression else frozenset()

    def _simple(self, variables: Variables) -> Quantity | None:
        """Return the quantity of a single ``$name``; None for any other expression."""
        name = self.text.strip().removeprefix(MARK)
        return _scalar(variables, name) if name.isidentifier() and MARK in self.text else None

    def _shown(self, quantity: Quantity) -> str:
        return self.text if self.literal else f"{self.text} = {quantity}"

    def _evaluate(self, variables: Variables, unit: str, difference: bool) -> float:
        if self.expression is None:
            raise ValueError("a literal is not evaluated")
        expected = type_of_unit(unit, difference=difference)
        return float(substituted(self.expression, variables).checked({}, expected=expected).evaluate({}))


def substituted(expression: Expression, variables: Variables) -> Expression:
    """Return the expression with every ``$variable`` replaced by its value.

    Raises
    ------
    RigctlError
        a variable is unknown, or is a list.
    """
    return expression.substitute({name: _scalar(variables, name) for name in expression.variables})


def _scalar(variables: Variables, name: str) -> Quantity:
    if name not in variables:
        raise unknown_name("variable", name, variables)
    found = variables[name]
    if isinstance(found, tuple):
        raise RigctlError("this variable is a list", value=MARK + name, expected="a single quantity")
    return found


def _in_dimension(quantity: Quantity, unit: str, difference: bool, text: str) -> float:
    if quantity.unit.dimension != parse_unit(unit).dimension:
        missing = quantity.unit.text == ""
        raise RigctlError(
            "the unit is missing" if missing else "wrong dimension",
            value=text,
            expected=describe(unit, difference=difference),
        )
    return quantity.unit.to_si(quantity.value, difference=difference)


def with_value(quantity: Quantity, value: float) -> Quantity:
    """Return a quantity with the same unit, rounded to 12 digits, so that 0.1 + 0.2 is shown as 0.3."""
    return Quantity(float(f"{value:.12g}"), quantity.unit)


#: three years in s: a longer time is a typing error, and sums of such times would lose digits
LONGEST = 1e8
DURATION = Kind("s", more_than=0.0, at_most=LONGEST)
PERIOD = Kind("s", at_least=0.0, at_most=LONGEST)
RATE = Kind("Hz", more_than=0.0, at_most=FASTEST, examples=("100 Hz",))
TEMPERATURE = Kind("K", at_least=0.0)
TEMPERATURE_TOLERANCE = Kind("K", difference=True, more_than=0.0, examples=("0.5 K",))
PRESSURE = Kind("Pa")
PRESSURE_TOLERANCE = Kind("Pa", more_than=0.0, examples=("0.5 bar",))
LENGTH = Kind("m")
LENGTH_TOLERANCE = Kind("m", more_than=0.0, examples=("1 mm",))
COUNT = Kind("1", at_least=0.0, at_most=1e6, whole=True)
SHARE = Kind("1", at_least=0.0, at_most=1.0, examples=("5 %",))
SEED = Kind("1", at_least=0.0, at_most=2.0**32 - 1.0, whole=True)
OPEN = Kind(None)
OPEN_DIFFERENCE = Kind(None, difference=True, examples=("10 K", "5 bar"))
OPEN_RATE = Kind(None, difference=True, examples=("10 K/s", "5 bar/s", "1 %/s"))
OPEN_TOLERANCE = Kind(None, difference=True, more_than=0.0, examples=("0.5 bar",))

Duration = Annotated[Value, DURATION]
Period = Annotated[Value, PERIOD]
Rate = Annotated[Value, RATE]
Temperature = Annotated[Value, TEMPERATURE]
TemperatureTolerance = Annotated[Value, TEMPERATURE_TOLERANCE]
Pressure = Annotated[Value, PRESSURE]
PressureTolerance = Annotated[Value, PRESSURE_TOLERANCE]
Length = Annotated[Value, LENGTH]
LengthTolerance = Annotated[Value, LENGTH_TOLERANCE]
Count = Annotated[Value, COUNT]
Share = Annotated[Value, SHARE]
Seed = Annotated[Value, SEED]
AnyValue = Annotated[Value, OPEN]
AnyDifference = Annotated[Value, OPEN_DIFFERENCE]
AnyRate = Annotated[Value, OPEN_RATE]
AnyTolerance = Annotated[Value, OPEN_TOLERANCE]
