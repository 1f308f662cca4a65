"""A range of a validity box in an effect file."""

from __future__ import annotations

import math

from rigctl.effects.user.quantity import read_quantity
from rigctl.effects.validity import ValidRange
from rigctl.errors import Location, RigctlError
from rigctl.files.quantity import in_dimension
from rigctl.physics.family import ModelFamily
from rigctl.physics.formulas import variable_types
from rigctl.units import Quantity


def read_range(
    over: str, ends: tuple[Quantity, Quantity], family: ModelFamily, where: Location | None = None
) -> ValidRange:
    """The range of the quantity `over`, which may be any smooth formula of the family's variables.

    Raises
    ------
    RigctlError
        the formula is invalid or uses an unknown name, or an end has another dimension, or the range is
        empty.
    """
    parsed = read_quantity(over, variable_types(family), where)
    written = f"[{ends[0]}, {ends[1]}]"
    if any(end.unit.dimension != parsed.type.dimension for end in ends):
        raise RigctlError(
            f"the range of {parsed.text} has another unit than {parsed.text}",
            value=written,
            expected=parsed.type.wanted,
        )
    unit = ends[0].unit.text or "1"
    low, high = (in_dimension(end, unit, difference=parsed.difference) for end in ends)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise RigctlError(
            f"the range of {parsed.text} is empty", value=written, expected="the lower end first"
        )
    return ValidRange(parsed.text, unit, low, high, parsed, parsed.difference)
