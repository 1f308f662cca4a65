"""The type of an expression's value: a dimension, and for temperatures whether it is a point or a
difference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rigctl.units import DIMENSIONLESS, Dimension, describe_dimension, parse_unit


@dataclass(frozen=True)
class ValueType:
    """A dimension and, for a temperature, whether it is a point on the scale or a difference.

    A temperature for which neither is specified (``300 K`` as written) may be used as either.
    """

    dimension: Dimension
    temperature: Literal["point", "difference"] | None = None
    boolean: bool = False

    def __str__(self) -> str:
        return self.wanted.partition(", e.g.")[0]

    @property
    def wanted(self) -> str:
        """The name of the type with an example, for messages."""
        if self.boolean:
            return "a condition, e.g. 'position < 1 mm'"
        return describe_dimension(self.dimension, difference=self.temperature == "difference")

    @property
    def is_temperature(self) -> bool:
        """True if the dimension is that of temperature."""
        return not self.boolean and self.dimension == KELVIN


@dataclass(frozen=True)
class TableType(ValueType):
    """A look-up table: the type of its values, and that of its argument."""

    over: ValueType | None = None


KELVIN = parse_unit("K").dimension
NUMBER = ValueType(DIMENSIONLESS)
BOOLEAN = ValueType(DIMENSIONLESS, boolean=True)


def type_of_unit(unit: str, *, difference: bool = False) -> ValueType:
    """Return the type of a value in `unit`; a temperature is a point unless it is a `difference`.

    Raises
    ------
    RigctlError
        the unit is unknown.
    """
    dimension = parse_unit(unit).dimension
    if dimension == KELVIN:
        return ValueType(dimension, "difference" if difference else "point")
    return ValueType(dimension)
