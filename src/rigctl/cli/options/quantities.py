"""Lists and ranges of quantities on the command line."""

from __future__ import annotations

import math

from rigctl.errors import RigctlError
from rigctl.units import parse_quantity, read_si

_MOST = 100_000


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
        own = item.lstrip("+-0123456789.eE:").strip()
        values += _read_item(item if own else f"{item} {shared}", unit)
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
