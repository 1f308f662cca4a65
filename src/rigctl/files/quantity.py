"""Field types for quantities, which are written with a unit in the file and are SI in the program.

``Annotated[float, Q("Pa")]`` reads ``30 bar`` as 3e6. The same declaration gives the JSON Schema from which
editors complete.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal
from rigctl.units import DIMENSIONLESS, Quantity, describe, parse_quantity, parse_unit, read_si

_NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"

_EXAMPLES = {
    "Pa": ("30 bar", "5 MPa"),
    "K": ("40 degC", "313.15 K"),
    "s": ("2 s", "10 min", "2 h"),
    "m": ("100 mm", "0.25 m"),
    "Hz": ("100 Hz", "10 Hz"),
    "m^3/s": ("14 l/min",),
    "W": ("1000 W", "2 kW"),
    "V": ("5 V",),
    "1": ("0.5", "50 %"),
}


@dataclass(frozen=True)
class Q:
    """Marks a float field as a quantity with the dimension of `unit`, stored in SI.

    Parameters
    ----------
    unit: any unit of the required dimension; "1" for a plain number.
    difference: whether it is a temperature interval (a tolerance, a noise), not a point on the scale.
    low, high: inclusive bounds, written with their units.
    positive: whether the value must be greater than zero.
    """

    unit: str
    difference: bool = False
    low: str | None = None
    high: str | None = None
    positive: bool = False

    def read(self, written: object) -> float:
        """Return the SI value of what is written in the file.

        Raises
        ------
        RigctlError
            it is not a quantity, has no unit or another dimension, or is out of bounds.
        """
        text = quantity_text(written, describe(self.unit, difference=self.difference))
        value = read_si(text, self.unit, difference=self.difference)
        if self.positive and value <= 0.0:
            raise RigctlError("must be greater than zero", value=text)
        if self.low is not None and value < self._bound(self.low):
            raise RigctlError("too small", value=text, expected=f"at least {self.low}")
        if self.high is not None and value > self._bound(self.high):
            raise RigctlError("too large", value=text, expected=f"at most {self.high}")
        return value

    def _bound(self, text: str) -> float:
        return read_si(text, self.unit, difference=self.difference)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read with `read`; a RigctlError becomes an error of the field."""
        return reader_schema(self.read)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe a text with a number and a unit, with examples."""
        described = describe(self.unit, difference=self.difference).partition(", e.g.")[0]
        examples = ("0.5 K",) if self.difference and self.unit == "K" else _EXAMPLES.get(self.unit)
        return quantity_schema(
            described, examples or (f"1 {self.unit}",), plain=parse_unit(self.unit).dimension == DIMENSIONLESS
        )


@dataclass(frozen=True)
class AnyQ:
    """Marks a field as a quantity whose dimension is not known from the schema alone.

    The field holds the `Quantity` as written; code that knows the dimension checks it and takes the SI value.
    """

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read with `read_quantity`; write to JSON in the form of the file."""
        as_text = core_schema.to_string_ser_schema(when_used="json-unless-none")
        return reader_schema(read_quantity, as_text)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe a text with a number and a unit."""
        return quantity_schema("a quantity", ("30 bar", "0.5 K", "100 mm"), plain=True)


#: a quantity of any dimension, kept as written
AnyQuantity = Annotated[Quantity, AnyQ()]


def read_quantity(written: object) -> Quantity:
    """Return the quantity as written, whatever its dimension.

    Raises
    ------
    RigctlError
        it is not a quantity, or its unit is unknown.
    """
    if isinstance(written, Quantity):
        return written
    return parse_quantity(quantity_text(written, "a number with its unit, e.g. '30 bar'"))


def in_dimension(quantity: Quantity, unit: str, *, difference: bool = False) -> float:
    """Return the SI value of a quantity that must have the dimension of `unit`.

    Raises
    ------
    RigctlError
        the unit is missing or has another dimension.
    """
    return read_si(quantity, unit, difference=difference)


def quantity_text(written: object, expected: str) -> str:
    """Return the text of a quantity in a file; refuses true, false, lists and mappings."""
    if isinstance(written, bool) or not isinstance(written, str | int | float):
        kind = "nothing" if written is None else _kind(written)
        raise RigctlError(f"{kind} where a quantity belongs", expected=expected)
    return str(written)


def _kind(written: object) -> str:
    names = {bool: "true/false", dict: "a mapping", list: "a list"}
    return names.get(type(written), type(written).__name__)


def reader_schema(
    read: Callable[[Any], Any], serialization: core_schema.SerSchema | None = None
) -> CoreSchema:
    """Return a pydantic schema that reads a value with `read`, and a RigctlError as an error of the field."""

    def validate(written: Any) -> Any:
        try:
            return read(written)
        except RigctlError as error:
            raise refusal(error) from error

    return core_schema.no_info_plain_validator_function(validate, serialization=serialization)


def quantity_schema(description: str, examples: tuple[str, ...], *, plain: bool) -> JsonSchemaValue:
    """Return the JSON Schema of a quantity; with `plain` a number without a unit is also valid."""
    text: JsonSchemaValue = {
        "type": "string",
        "pattern": rf"^\s*{_NUMBER}\s*{'.*' if plain else '[^0-9].*'}$",
        "examples": list(examples),
        "description": description,
    }
    if plain:
        text["type"] = ["string", "number"]
    return text
