"""The SI unit that a display unit stands for."""

from __future__ import annotations

from functools import lru_cache

from rigctl.units import parse_unit


@lru_cache(maxsize=256)
def si_unit(unit: str) -> str:
    """The unit of the same dimension with factor one: ``mm^2`` is ``m^2``, ``bar`` is ``kg*m^-1*s^-2``.

    Raises
    ------
    RigctlError
        the unit is unknown.
    """
    parsed = parse_unit(unit)
    if parsed.factor == 1.0 and parsed.offset == 0.0:
        return unit
    return "*".join(str(parsed.dimension).split(" "))
