"""Lists and ranges of quantities on the command line."""

from __future__ import annotations

import math

from rigctl.errors import RigctlError
from rigctl.units import UNITS_OF, Quantity, describe, parse_quantity, parse_unit, read_si

_MOST = 100_000


def read_option(
    option: str, text: str, *units: str, difference: bool = False, above_zero: bool = False
) -> Quantity:
    """Read the value of an option, or a part of it, of one of the dimensions of `units`.

    Parameters
    ----------
    difference: a temperature is an interval.
    above_zero: zero and negative values are refused.

    Raises
    ------
    RigctlError
        it is none; names the option, and every unit that is allowed.
    """
    expected = " or ".join(_allowed(unit, difference=difference) for unit in units)
    try:
        quantity = parse_quantity(text.strip())
    except RigctlError as error:
        raise RigctlError(
            f"{option}: {error.what}", value=text, expected=expected, nearest=error.nearest
        ) from error
    if all(quantity.unit.dimension != parse_unit(unit).dimension for unit in units):
        missing = quantity.unit.text == ""
        what = "the unit is missing" if missing else "wrong dimension"
        raise RigctlError(f"{option}: {what}", value=text, expected=expected)
    if above_zero and quantity.value <= 0.0:
        raise RigctlError(f"{option}: too small", value=text, expected="more than zero")
    return quantity


def _allowed(unit: str, *, difference: bool) -> str:
    """``a time in s, ms, min, h or day``."""
    dimension = parse_unit(unit).dimension
    for quantity, units in UNITS_OF.items():
        if parse_unit(units[0]).dimension == dimension:
            if difference and quantity == "temperature":
                quantity, units = "temperature difference", ("K",)  # noqa: PLW2901 - of an interval
            listed = units[0] if len(units) == 1 else f"{', '.join(units[:-1])} or {units[-1]}"
            return f"a{'n' * (quantity[0] in 'aeio')} {quantity} in {listed}"
    return describe(unit, difference=difference)


def read_quantities(text: str, unit: str) -> list[float]:
    """Read ``20 degC``, ``20, 40, 60 degC`` or ``20:80:10 degC`` (from, to, step) into SI values.

    An item without a unit takes that of the last one.

    Raises
    ------
    RigctlError
        an item is no quantity or of another dimension than `unit`, or a range is empty or endless.
    """
    items = [item.strip() for item in text.split(",")]
    shared = items[-1].lstrip("+-0123456789.eE:").strip()
    values: list[float] = []
    for item in items:
        own_unit = item.lstrip("+-0123456789.eE:").strip()
        values += _read_item(item if own_unit else f"{item} {shared}", unit)
    return values


def _read_item(item: str, unit: str) -> list[float]:
    parts = item.split(":")
    if len(parts) == 1:
        return [read_si(item, unit)]
    if len(parts) != 3:
        raise RigctlError("not a range", value=item, expected="from:to:step with a unit, e.g. 20:80:10 degC")
    step = parse_quantity(parts[2])
    first, last = (read_si(f"{part} {step.unit.text}", unit) for part in parts[:2])
    size = step.unit.to_si(step.value, difference=True)
    if size == 0.0 or (last - first) / size < 0.0:
        raise RigctlError("a range that never ends", value=item, expected="a step towards the end")
    # a part in a million keeps the end in, whatever the rounding of the unit
    count = math.floor((last - first) / size + 1e-6) + 1
    if count > _MOST:
        raise RigctlError("the range is too long", value=item, expected=f"at most {_MOST} values")
    return [first + size * index for index in range(count)]
