"""Expressions: conditions and formulas, parsed from a user's files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from rigctl.errors import Location, RigctlError
from rigctl.expressions.check import Typed, fit, infer
from rigctl.expressions.compile import compile_tree
from rigctl.expressions.functions import FUNCTIONS, Function
from rigctl.expressions.nodes import Constant, Literal, Name, Node, Variable, replace_leaves, walk
from rigctl.expressions.parser import parse_tree
from rigctl.expressions.substitute import substitute, substitute_text
from rigctl.expressions.types import ValueType
from rigctl.units import Quantity


@dataclass(frozen=True)
class Expression:
    """A condition or a formula in a user's file: parsed, and never executed as a program.

    Two expressions are equal if their texts are equal.
    """

    text: str
    root: Node = field(compare=False, repr=False)
    where: Location = field(default=Location(), compare=False, repr=False)
    #: the tree with its numbers in SI, once the types of its names are known
    resolved: Node | None = field(default=None, compare=False, repr=False)

    @cached_property
    def names(self) -> frozenset[str]:
        """The channels, commands and measures in the expression."""
        return frozenset(node.name for node in walk(self.root) if isinstance(node, Name))

    @cached_property
    def variables(self) -> frozenset[str]:
        """The ``$variables`` in the expression, without their dollars."""
        return frozenset(node.name for node in walk(self.root) if isinstance(node, Variable))

    @property
    def constant(self) -> bool:
        """True if the expression contains no names and no variables."""
        return not self.names and not self.variables

    def check(self, types: Mapping[str, ValueType], *, expected: ValueType | None = None) -> ValueType:
        """Return the type of its value.

        Parameters
        ----------
        types: the type of each name; a variable is written with its dollar, ``$oil``.
        expected: the required type, which also decides whether ``0.5 degC`` alone is a point or a difference.

        Raises
        ------
        RigctlError
            a name is unknown, dimensions are incompatible, or the type is not the expected one.
        """
        return self._typed(types, expected).type

    def checked(self, types: Mapping[str, ValueType], *, expected: ValueType | None = None) -> Expression:
        """Return the same expression with its numbers in SI, so that it can be evaluated.

        Raises
        ------
        RigctlError
            as `check`.
        """
        return replace(self, resolved=self._typed(types, expected).node)

    def evaluate(self, values: Mapping[str, float]) -> float | bool:
        """Return its value for SI values by name; variables are written with their dollar.

        An undefined value (a division by zero, the logarithm of a negative number) is NaN, and a comparison
        with NaN is false.

        Raises
        ------
        RigctlError
            a name has no value.
        ValueError
            the expression has a literal in degC and a name, and was not `checked`, so that it is unknown
            whether the literal is a point or a difference.
        """
        return compile_tree(self._in_si(), tuple(values))(tuple(values.values()))

    def compile(
        self, types: Mapping[str, ValueType], row: Sequence[str]
    ) -> Callable[[Sequence[float]], float | bool]:
        """Return a fast function of a row of SI values whose columns are named `row`.

        Raises
        ------
        RigctlError
            as `check`; also for a name that is not a column of the row.
        """
        known = {name: kind for name, kind in types.items() if name in row}
        return compile_tree(self._typed(known, None).node, row)

    def substitute(self, values: Mapping[str, Quantity]) -> Expression:
        """Return the same expression with some variables replaced by quantities; the others are unchanged.

        `values` is keyed by name, without the dollar. The result must be `checked` again.
        """
        text, root = substitute_text(self.text, values), substitute(self.root, values)
        return replace(self, text=text, root=root, resolved=None)

    def _typed(self, types: Mapping[str, ValueType], expected: ValueType | None) -> Typed:
        try:
            typed = infer(self.root, types)
            return typed if expected is None else fit(typed, expected)
        except RigctlError as error:
            if error.value is None:
                error.value = self.text
            raise error.at(self.where) from None

    def _in_si(self) -> Node:
        if self.resolved is not None:
            return self.resolved
        if self.constant:
            return self._typed({}, None).node
        return replace_leaves(self.root, self._constant)

    def _constant(self, node: Node) -> Node:
        if not isinstance(node, Literal):
            return node
        if node.unit.absolute_temperature:
            raise ValueError(f"'{self.text}' must be checked before it is evaluated")
        return Constant(node.unit.to_si(node.value), node.unit.dimension)


def parse(
    text: str, where: Location | None = None, *, functions: Mapping[str, Function] = FUNCTIONS
) -> Expression:
    """Read an expression; `functions` are those that it may call.

    Raises
    ------
    RigctlError
        the text is not an expression of the grammar (see `rigctl.expressions.parser`).
    """
    place = where or Location()
    return Expression(text, parse_tree(text, place, functions), place)
