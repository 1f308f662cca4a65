"""The SI unit with the dimension of a display unit."""

from __future__ import annotations

from functools import lru_cache

from rigctl.units import Dimension, is_speed_of_rotation, parse_unit

#: derived units preferred to products of base units
_NAMED = ("Pa", "N", "W", "J", "V")
#: a quotient with a name of its own in mechanics, stiffness, although Pa*m has as few factors
_USUAL = ("N/m",)
#: further derived units, used if they make the unit shorter
_ELECTRICAL = ("ohm", "H", "F", "C")
#: additional cost of a factor in the denominator when forms of a unit are compared
_BELOW = 0.1


@lru_cache(maxsize=256)
def si_unit(unit: str) -> str:
    """The unit of the same dimension with factor one: ``mm^2`` is ``m^2``, ``rpm`` is ``rad/s``.

    Raises
    ------
    RigctlError
        the unit is unknown.
    """
    parsed = parse_unit(unit)
    if parsed.factor == 1.0 and parsed.offset == 0.0:
        return unit
    return "rad/s" if is_speed_of_rotation(unit) else si_unit_of(parsed.dimension)


def si_unit_of(dimension: Dimension) -> str:
    """The SI unit of a dimension in the fewest factors: ``ohm``, ``N*s/m``, ``W/K`` rather than base units.

    Otherwise it contains at most one named derived unit, in the numerator or the denominator, beside powers
    of the base units, and only if the number of different units does not increase: m^4/s^2 is not J*m^2/kg.
    """
    for name in (*_NAMED, *_USUAL):
        if parse_unit(name).dimension == dimension:
            return name
    unit, fewest = _quotient(dimension), _reading(dimension)
    most = _different(dimension)
    for name in (*_NAMED, *_ELECTRICAL):
        named = parse_unit(name).dimension
        for rest, line in ((dimension / named, 1.0), (dimension * named, 1.0 + _BELOW)):
            if line + _reading(rest) < fewest and 1 + _different(rest) <= most:
                fewest = line + _reading(rest)
                unit = _with_named(rest, name, above=line == 1.0)
    return unit


def _quotient(dimension: Dimension) -> str:
    """A quotient of products of base units: ``kg/(m*s)``."""
    factors = [] if dimension.dimensionless else str(dimension).split(" ")
    above = [factor for factor in factors if "^-" not in factor]
    below = [factor.replace("^-", "^").removesuffix("^1") for factor in factors if "^-" in factor]
    top = "*".join(above) or "1"
    if not below:
        return top
    return f"{top}/{below[0]}" if len(below) == 1 else f"{top}/({'*'.join(below)})"


def _reading(dimension: Dimension) -> float:
    """Cost of a unit's form: the sum of the exponents' magnitudes, slightly more in the denominator."""
    return float(sum(abs(one) * (1.0 if one > 0 else 1.0 + _BELOW) for one in dimension.exponents))


def _different(dimension: Dimension) -> int:
    return sum(1 for one in dimension.exponents if one)


def _with_named(rest: Dimension, name: str, *, above: bool) -> str:
    """A product of base units multiplied or divided by a named unit."""
    if rest.dimensionless:
        return name if above else f"1/{name}"
    top, _, bottom = _quotient(rest).partition("/")
    below = bottom.strip("()").split("*") if bottom else []
    over = [] if top == "1" else top.split("*")
    over, below = ([name, *over], below) if above else (over, [name, *below])
    line = "*".join(over) or "1"
    if not below:
        return line
    return f"{line}/{below[0]}" if len(below) == 1 else f"{line}/({'*'.join(below)})"
