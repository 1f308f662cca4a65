"""The names that a formula may use, and the type of each."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.expressions.functions import ALL_FUNCTIONS
from rigctl.expressions.tokens import WORDS
from rigctl.expressions.types import NUMBER, ValueType, type_of_unit
from rigctl.physics.family import Definition, InputVariable, ModelFamily, StateVariable
from rigctl.units import parse_unit

#: named constants
CONSTANTS = ("pi",)


def variable_types(family: ModelFamily) -> Mapping[str, ValueType]:
    """The type of every variable of `family`.

    A temperature is a point on the scale unless it is declared as a difference. A parameter may be used as
    either.
    """
    named: tuple[StateVariable | InputVariable | Definition, ...]
    named = (*family.states, *family.inputs, *family.definitions)
    types = {item.name: type_of_unit(item.unit, difference=item.difference) for item in named}
    types |= {p.name: ValueType(parse_unit(p.unit).dimension) for p in family.parameters}
    types |= {name: curve.type for name, curve in family.tables.items()}
    return types | dict.fromkeys(CONSTANTS, NUMBER)


def reserved_names() -> frozenset[str]:
    """The names that no variable may have, because they mean something else in a formula."""
    return frozenset({*CONSTANTS, *ALL_FUNCTIONS, *WORDS})
