"""Common parts of the generic effects: bounds, and smooth corners."""

from __future__ import annotations

from collections import Counter
from typing import Any

from rigctl.effects.declaration import Effect, EffectParameter, Term
from rigctl.engine.symbols import Scalar, positive_part, smooth_sign
from rigctl.physics.family import ModelFamily
from rigctl.physics.si_unit import si_unit_of
from rigctl.units import parse_unit

#: bounds as a multiple of the typical size: wide, because that is a guess
WIDE = 1e4
#: width of the rounded corner of a threshold, as a share of a range
CORNER = 0.003
ARMSTRONG = "Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083"
BOUC_WEN = "Bouc (1967); Wen, J. Eng. Mech. Div. ASCE 102 (1976) 249, with n = 1, which is Dahl's friction"
SENSORS = "Doebelin, Measurement Systems: Application and Design"


def quotient(above: str, *below: str) -> str:
    """The SI unit of ``above/(below*...)``."""
    dimension = parse_unit(above).dimension
    for unit in below:
        dimension = dimension / parse_unit(unit).dimension
    return si_unit_of(dimension)


def shown_quotient(above: str, *below: str) -> str:
    """``above/(below*...)`` in the given units: ``l/min/bar^2`` for 'l/min', 'bar' and 'bar'."""
    written = above
    for unit, count in Counter(below).items():
        if unit != "1":
            plain = unit if unit.isalpha() else f"({unit})"
            written += f"/{plain}" + (f"^{count}" if count > 1 else "")
    return quotient(above, *below) if parse_unit(written).dimension.dimensionless else written


def shown_product(first: str, second: str) -> str:
    """``first*second`` in the given units, or their SI unit if it has no dimension."""
    dimension = parse_unit(first).dimension * parse_unit(second).dimension
    return si_unit_of(dimension) if dimension.dimensionless or "/" in first else f"{first}*{second}"


def placed(
    family: ModelFamily,
    slot: str,
    law: str,
    ending: str,
    *,
    term: Term,
    confused: tuple[str, ...] = (),
    becomes: tuple[tuple[str, float, str], ...] = (),
    **declared: Any,
) -> Effect:
    """The effect of a law at a slot of a family, called ``<law><ending>``; its rivals are at the same slot.

    Parameters
    ----------
    confused: laws of the effects with which it may be confused.
    becomes: parameter, its limiting value, and the law that this one becomes.
    declared: other fields of `rigctl.effects.declaration.Effect`.
    """
    return Effect(
        name=f"{law}{ending}",
        family=family.name,
        terms=((slot, term),),
        confused_with=tuple(f"{one}{ending}" for one in confused),
        becomes=tuple((name, value, f"{one}{ending}") for name, value, one in becomes),
        own_family=family,
        **declared,
    )


def one_sign(name: str, unit: str, typical: float, meaning: str, difference: bool = True) -> EffectParameter:
    """A size that can physically have only one sign."""
    return EffectParameter(name, unit, 0.0, typical, 0.0, WIDE * typical, meaning, difference, physical="low")


def either_sign(name: str, unit: str, typical: float, meaning: str) -> EffectParameter:
    """A size of either sign."""
    return EffectParameter(
        name, unit, 0.0, typical, -WIDE * typical, WIDE * typical, meaning, True, physical="none"
    )


def share(name: str, meaning: str, low: float = 0.0) -> EffectParameter:
    """The share of a limit that is effective: 1 is a hard limit."""
    return EffectParameter(name, "1", 0.0, 0.5, low, 1.5, meaning, physical="both")


def shape(
    name: str,
    unit: str,
    typical: float,
    meaning: str,
    grid: tuple[float, ...] = (),
    *,
    within: str = "",
    shares: tuple[float, ...] = (),
    low: float | None = None,
    high: float | None = None,
    difference: bool = True,
) -> EffectParameter:
    """A shape parameter of a term that a size switches on; it is fitted once the effect is in the model."""
    return EffectParameter(
        name,
        unit,
        None,
        typical,
        typical / WIDE if low is None else low,
        typical * WIDE if high is None else high,
        meaning,
        difference,
        grid,
        within=within,
        shares=shares,
        refined=True,
        physical="none",
    )


def sign(x: Scalar, width: Scalar) -> Scalar:
    """The smooth sign of x."""
    return smooth_sign(x, width)


def beyond(x: Scalar, limit: Scalar, width: Scalar) -> Scalar:
    """The excess of x over `limit`, with a smooth corner; 0 below it."""
    return positive_part(x - limit, width)
