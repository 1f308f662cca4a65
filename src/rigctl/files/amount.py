"""An SI value that retains the unit in which it was written.

It is used for fields whose dimension depends on another part of the file, such as the limit of a channel or a
constant of the model. It can be used as a float; code that knows the dimension checks it with `Amount.check`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Self

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from rigctl.errors import RigctlError
from rigctl.files.quantity import quantity_schema, quantity_text, reader_schema
from rigctl.units import Unit, describe, parse_quantity, parse_unit


class Amount(float):
    """A float in SI, with its unit and text in the file."""

    __slots__ = ("text", "unit")
    unit: Unit
    text: str

    def __new__(cls, si: float, unit: Unit, text: str) -> Self:
        """Make an amount of the SI value `si`, which was written as `text`, in `unit`."""
        amount = super().__new__(cls, si)
        amount.unit = unit
        amount.text = text
        return amount

    def __getnewargs__(self) -> tuple[float, Unit, str]:  # type: ignore[override]
        """Return the arguments for copying and unpickling."""
        return float(self), self.unit, self.text

    def check(self, unit: str, *, difference: bool = False, expected: str | None = None) -> None:
        """Refuse a dimension other than that of `unit`; `expected` describes it in the message.

        Raises
        ------
        RigctlError
            the unit is missing or has another dimension.
        """
        if self.unit.dimension != parse_unit(unit).dimension:
            raise RigctlError(
                "wrong dimension" if self.unit.text else "the unit is missing",
                value=self.text,
                expected=expected or describe(unit, difference=difference),
            )


@dataclass(frozen=True)
class AmountField:
    """Reads an `Amount`; with `difference`, a temperature is an interval; `per_second`: it is a rate."""

    difference: bool = False
    per_second: bool = False

    def read(self, written: object) -> Amount:
        """Return the amount that is written in the file.

        Raises
        ------
        RigctlError
            it is not a quantity, or its unit is unknown.
        """
        if isinstance(written, Amount):
            return written
        text = quantity_text(written, "a number with its unit, e.g. '30 bar'")
        quantity = parse_quantity(text)
        si = quantity.unit.to_si(quantity.value, difference=self.difference)
        return Amount(si, quantity.unit, text)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read with `read`; a RigctlError becomes an error of the field."""
        return reader_schema(self.read)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe a text with a number and a unit, or a plain number."""
        examples = ("0.5 K", "0.1 bar") if self.difference else ("30 bar", "100 mm", "40 degC")
        if self.per_second:
            examples = ("0.5 K/s", "5 bar/s", "1 %/s")
        return quantity_schema("a quantity", examples, plain=True)


#: a quantity of any dimension, as a float in SI
AnyAmount = Annotated[Amount, AmountField()]
#: amounts of tolerances, noise and other intervals
AnyDifference = Annotated[Amount, AmountField(difference=True)]
#: changes per second
AnyRate = Annotated[Amount, AmountField(difference=True, per_second=True)]
