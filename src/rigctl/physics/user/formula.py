"""A formula of a family file as a callable for the equations."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.engine.symbols import Scalar
from rigctl.expressions.nodes import Node
from rigctl.physics.formulas import lower
from rigctl.physics.scope import Scope

#: additional names in the formula of a delay: the commanded values around the switch
BEFORE, AFTER = "before", "after"


@dataclass(frozen=True)
class TextFormula:
    """A checked formula; `sums` and `factors` are the slots among its names.

    Called with a scope; that of a delay also with the commanded values before and after.
    """

    tree: Node
    sums: frozenset[str] = frozenset()
    factors: frozenset[str] = frozenset()

    def __call__(self, m: Scope, *switch: Scalar) -> Scalar:
        """Its value in `m`."""
        local = dict(zip((BEFORE, AFTER), switch, strict=False))

        def look_up(name: str) -> Scalar:
            if name in local:
                return local[name]
            if name in self.sums:
                return m.total(name)
            return m.factor(name) if name in self.factors else m[name]

        return lower(self.tree, m, look_up)


def unwritten(m: Scope, *switch: Scalar) -> Scalar:
    """Placeholder for a formula until all names are known and formulas can be parsed."""
    raise TypeError("this formula has not been read yet")
