"""Parsing of the text of a term into a formula of the model's symbols."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.effects.declaration import EffectParameter, Own, Term
from rigctl.effects.user.names import slot_type, term_types
from rigctl.engine.symbols import Scalar
from rigctl.errors import Location
from rigctl.expressions.nodes import Node
from rigctl.physics.family import ModelFamily, Slot
from rigctl.physics.formulas import lower, read_formula
from rigctl.physics.scope import Scope


@dataclass(frozen=True)
class TextTerm:
    """A checked term; `parameters` are those of its names that are parameters of the effect."""

    tree: Node
    parameters: frozenset[str]

    def __call__(self, m: Scope, p: Own) -> Scalar:
        """Its value with the model's variables `m` and the effect's parameters `p`."""
        return lower(self.tree, m, lambda name: p[name] if name in self.parameters else m[name])


def read_term(
    text: str,
    family: ModelFamily,
    slot: Slot,
    parameters: Sequence[EffectParameter],
    where: Location | None = None,
) -> Term:
    """The formula of a text.

    Raises
    ------
    RigctlError
        it is not valid in the grammar, branches, uses an unknown name, or has another dimension than the
        slot.
    """
    tree = read_formula(
        text,
        term_types(family, slot, parameters),
        slot_type(slot),
        what=f"the term at {slot.name}",
        why="as every term there" if slot.combine == "sum" else "as every factor there",
        where=where,
    )
    return TextTerm(tree, frozenset(parameter.name for parameter in parameters))
