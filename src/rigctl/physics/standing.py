"""How well a number is known: measured, assumed within a range, or exact."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal, TypeAlias

from rigctl.errors import RigctlError
from rigctl.units import parse_unit, show

#: "" where a file does not say it: such a number counts as exact
Standing: TypeAlias = Literal["", "measured", "assumed", "exact"]
#: by name
STANDINGS: Final[Mapping[str, Standing]] = MappingProxyType(
    {"measured": "measured", "assumed": "assumed", "exact": "exact"}
)
#: range of an assumed number whose file states none, as a factor to either side
FACTOR = 2.0


def range_of(
    name: str, value: float, unit: str, standing: Standing, stated: tuple[float, float] | None
) -> tuple[float, float] | None:
    """The range of an assumed number, SI: as stated, or a factor of 2 to either side; None for any other.

    Raises
    ------
    RigctlError
        a range of a number that is not assumed, or one without the number in it; or none is stated of zero,
        or of a point on a temperature scale, of which half and twice mean nothing.
    """
    if standing != "assumed":
        if stated is not None:
            raise RigctlError(f"{name} has a range, but is not assumed", hint="Write 'standing: assumed' too")
        return None
    if stated is not None:
        low, high = stated
        if not low < high or not low <= value <= high:
            words = f"{show(low, unit)} to {show(high, unit)}"
            raise RigctlError(
                f"the range of {name} does not contain its value", value=words, expected=show(value, unit)
            )
        return stated
    if value == 0.0 or parse_unit(unit).absolute_temperature:
        raise RigctlError(
            f"{name} is assumed, and half and twice {show(value, unit)} are no range",
            expected="range: [LOW, HIGH]",
        )
    ends = (value / FACTOR, value * FACTOR)
    return min(ends), max(ends)
