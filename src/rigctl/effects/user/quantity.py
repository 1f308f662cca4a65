"""A quantity that an effect file names: a variable of the model, or a formula of several."""

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
    """A formula whose dimension is its own: called with a scope it is the quantity's value."""

    text: str
    tree: Node
    type: ValueType

    def __call__(self, m: Scope) -> Scalar:
        """Its value, SI."""
        return lower(self.tree, m, lambda name: m[name])

    @property
    def difference(self) -> bool:
        """Whether it is an interval of temperatures."""
        return self.type.temperature == "difference"

    @property
    def names(self) -> frozenset[str]:
        """What it names."""
        return frozenset(node.name for node in walk(self.tree) if isinstance(node, Name))


def read_quantity(text: str, types: Mapping[str, ValueType], where: Location | None = None) -> ReadQuantity:
    """The quantity that `text` is, a smooth formula of names of `types`.

    Raises
    ------
    RigctlError
        it is none of the grammar, branches, or names what there is not.
    """
    place = where or Location()
    refuse_branch_words(text, place)
    expression = parse(text, place, functions=ALL_FUNCTIONS)
    refuse_corners(expression)
    found = expression.check(types)
    said = " ".join(text.split())
    return ReadQuantity(said, read_formula(text, types, found, what=said, where=where), found)
