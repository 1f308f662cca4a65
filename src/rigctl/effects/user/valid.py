"""A range of a validity box, as an effect file has it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigctl.effects.validity import ValidRange
from rigctl.engine.symbols import Scalar
from rigctl.errors import Location, RigctlError
from rigctl.expressions import parse
from rigctl.expressions.functions import ALL_FUNCTIONS
from rigctl.expressions.nodes import Node
from rigctl.files.quantity import in_dimension
from rigctl.physics.family import ModelFamily
from rigctl.physics.formulas import lower, read_formula, refuse_branch_words, refuse_corners, variable_types
from rigctl.physics.scope import Scope
from rigctl.units import Quantity


@dataclass(frozen=True)
class _Quantity:
    tree: Node

    def __call__(self, m: Scope) -> Scalar:
        return lower(self.tree, m, lambda name: m[name])


def read_range(
    over: str, ends: tuple[Quantity, Quantity], family: ModelFamily, where: Location | None = None
) -> ValidRange:
    """The range of the quantity `over`, which may be any smooth formula of the family's variables.

    Raises
    ------
    RigctlError
        the formula is wrong or names what there is not, an end has another dimension, or they are no range.
    """
    types = variable_types(family)
    place = where or Location()
    refuse_branch_words(over, place)
    expression = parse(over, place, functions=ALL_FUNCTIONS)
    refuse_corners(expression)
    found = expression.check(types)
    tree = read_formula(over, types, found, what=f"the range of {over}", where=where)
    difference = found.temperature == "difference"
    written = f"[{ends[0]}, {ends[1]}]"
    for end in ends:
        if end.unit.dimension != found.dimension:
            raise RigctlError(
                f"the range of {over} has another unit than {over}", value=written, expected=found.wanted
            )
    unit = ends[0].unit.text or "1"
    low, high = (in_dimension(end, unit, difference=difference) for end in ends)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise RigctlError(f"the range of {over} is empty", value=written, expected="the lower end first")
    return ValidRange(" ".join(over.split()), unit, low, high, _Quantity(tree), difference)
