"""The SI unit that a display unit stands for."""

from __future__ import annotations

from functools import lru_cache

from rigctl.units import Dimension, parse_unit

#: what a person calls it, rather than a product of base units
_NAMED = ("Pa", "N", "W", "J", "V")


@lru_cache(maxsize=256)
def si_unit(unit: str) -> str:
    """The unit of the same dimension with factor one: ``mm^2`` is ``m^2``, ``l/min`` is ``m^3/s``.

    Raises
    ------
    RigctlError
        the unit is unknown.
    """
    parsed = parse_unit(unit)
    if parsed.factor == 1.0 and parsed.offset == 0.0:
        return unit
    return unit_of(parsed.dimension)


def unit_of(dimension: Dimension) -> str:
    """The SI unit of a dimension: its own name (N, Pa, ...) where it has one, else base units."""
    for name in _NAMED:
        if parse_unit(name).dimension == dimension:
            return name
    return _quotient(dimension)


def _quotient(dimension: Dimension) -> str:
    """Base units over base units: ``kg/(m*s)``."""
    factors = [] if dimension.dimensionless else str(dimension).split(" ")
    above = [factor for factor in factors if "^-" not in factor]
    below = [factor.replace("^-", "^").removesuffix("^1") for factor in factors if "^-" in factor]
    top = "*".join(above) or "1"
    if not below:
        return top
    return f"{top}/{below[0]}" if len(below) == 1 else f"{top}/({'*'.join(below)})"
