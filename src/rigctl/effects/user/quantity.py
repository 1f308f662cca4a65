"""A quantity in an effect file: a variable of the model, or a formula of several."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rigctl.engine.symbols import Scalar
from rigctl.errors import Location
from rigctl.expressions import ValueType, parse
from rigctl.expressions.functions import ALL_FUNCTIONS
from rigctl.expressions.nodes import Name, Node, walk
from rigctl.physics.formulas import lower, read_formula, refuse_branch_words, refuse_corners
from rigctl.physics.scope import Scope


@dataclass(frozen=True)
class ReadQuantity:
    """A formula of any dimension: called with a scope it returns the quantity's value."""

    text: str
    tree: Node
    type: ValueType

    def __call__(self, m: Scope) -> Scalar:
        """Its value, SI."""
        return lower(self.tree, m, lambda name: m[name])

    @property
    def difference(self) -> bool:
        """Whether it is a temperature difference."""
        return self.type.temperature == "difference"

    @property
    def names(self) -> frozenset[str]:
        """The names that it uses."""
        return frozenset(node.name for node in walk(self.tree) if isinstance(node, Name))


def read_quantity(text: str, types: Mapping[str, ValueType], where: Location | None = None) -> ReadQuantity:
    """The quantity of a text, a smooth formula of the names in `types`.

    Raises
    ------
    RigctlError
        it is not valid in the grammar, branches, or uses an unknown name.
    """
    location = where or Location()
    refuse_branch_words(text, location)
    expression = parse(text, location, functions=ALL_FUNCTIONS)
    refuse_corners(expression)
    value_type = expression.check(types)
    normalised = " ".join(text.split())
    return ReadQuantity(
        normalised, read_formula(text, types, value_type, what=normalised, where=where), value_type
    )
