"""Which formulas need no dimensional number besides the model's declared parameters (Buckingham's theorem).

Tier A: a pure number times a product of powers of declared parameters has the dimension that the formula
needs; tier B: one coefficient with a dimension of its own, with which any formula can be made consistent.
Tier B is the weaker claim.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from rigctl.discovery.formulas import Formula
from rigctl.discovery.grammar import DISTANCES
from rigctl.model.model import Model
from rigctl.units import Dimension, parse_unit

#: exponents in groups, and number of parameters in a group: with more, any number could be made
_EXPONENTS = (-2.0, -1.0, -0.5, 0.5, 1.0, 2.0)
_MOST = 2
#: range of a pure number in physics
_LEAST, _LARGEST = 0.01, 100.0

_POWERS = {
    "linear": 1.0,
    "power_half": 0.5,
    "power_three_halves": 1.5,
    "power_two": 2.0,
    "power_three": 3.0,
    "even_half": 0.5,
    "even_one": 1.0,
    "even_two": 2.0,
}


@dataclass(frozen=True)
class Tier:
    """The strength of a formula's claim.

    Attributes
    ----------
    coefficient: in front of the group, a pure number; for tier B in the unit given by `group`.
    group: ``mass*stiffness^0.5``, or the unit of the coefficient.
    scales: the pure number and the group of each scale that has a dimension; for tier A.
    lacking: what has a dimension that no group has; for tier B.
    """

    letter: Literal["A", "B"]
    coefficient: float
    group: str
    scales: tuple[tuple[float, str], ...] = ()
    lacking: Literal["", "size", "scale"] = ""


def tier_of(formula: Formula, model: Model) -> Tier:
    """The tier of a formula with fitted size and scales."""
    size, dimension, unit = _coefficient(formula)
    scales = [
        (one.argument.scale_si(kind, x), parse_unit(one.argument.driver.unit).dimension)
        for one in formula.factors
        for kind, x in zip(one.form.scales, one.scales, strict=True)
        if kind in DISTANCES or not one.argument.point
    ]
    groups = [_group(value, of, model) for value, of in [(size, dimension), *scales]]
    known = [one for one in groups if one is not None]
    if len(known) == len(groups):
        (number, text), *others = known
        return Tier("A", number, text, tuple((value, group) for value, group in others if group))
    return Tier("B", size, unit, lacking="size" if groups[0] is None else "scale")


def _coefficient(formula: Formula) -> tuple[float, Dimension, str]:
    """The coefficient when powers of a variable are written without their references."""
    value, dimension = formula.size, parse_unit(formula.slot.unit).dimension
    unit = formula.slot.unit
    for one in formula.factors:
        power = _POWERS.get(one.form.name, 0.0)
        if power:
            value /= one.argument.reference**power
            dimension = dimension / parse_unit(one.argument.driver.unit).dimension ** power
            unit = f"{unit} per ({one.argument.driver.unit})^{power:g}"
    return value, dimension, unit


def _group(value: float, dimension: Dimension, model: Model) -> tuple[float, str] | None:
    """The simplest product of powers of parameters with a dimension, and the number in front of it."""
    if dimension.dimensionless:
        return value, ""
    best: tuple[float, float, str] | None = None
    for count, cost, size, text in _products(dimension, model):
        number = value / size
        if _LEAST <= abs(number) <= _LARGEST and (best is None or (count + cost) < best[0]):
            best = (count + cost, number, text)
    return None if best is None else best[1:]


def _products(dimension: Dimension, model: Model) -> Iterator[tuple[int, float, float, str]]:
    """For each product: number of parameters, deviation of their exponents from 1, its value and its text."""
    known = _parameters(model)
    powers = {
        (name, power): tuple(float(one) for one in (of**power).exponents)
        for name, (_, of) in known.items()
        for power in _EXPONENTS
    }
    wanted = tuple(float(one) for one in dimension.exponents)
    for count in range(1, _MOST + 1):
        for chosen in combinations(powers, count):
            if len({name for name, _ in chosen}) < count:
                continue
            if tuple(map(sum, zip(*(powers[one] for one in chosen), strict=True))) != wanted:
                continue
            size = math.prod(known[name][0] ** power for name, power in chosen)
            text = "*".join(name if power == 1.0 else f"{name}^{power:g}" for name, power in chosen)
            yield count, sum(abs(abs(power) - 1.0) for _, power in chosen), size, text


def _parameters(model: Model) -> Mapping[str, tuple[float, Dimension]]:
    """Positive parameters with a dimension, by name: value and dimension."""
    parameters: dict[str, tuple[float, Dimension]] = {}
    for one in model.family.parameters:
        value, dimension = model.values.get(one.name, one.value), parse_unit(one.unit).dimension
        if value > 0.0 and not dimension.dimensionless:
            parameters[one.name] = (value, dimension)
    return parameters
