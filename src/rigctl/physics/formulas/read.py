"""Parsing of the text of a formula into a checked tree."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.errors import Location, RigctlError
from rigctl.expressions import ValueType, parse
from rigctl.expressions.functions import ALL_FUNCTIONS
from rigctl.expressions.nodes import Node
from rigctl.physics.formulas.corners import refuse_branch_words, refuse_corners


def read_formula(
    text: str,
    types: Mapping[str, ValueType],
    wanted: ValueType,
    *,
    what: str,
    why: str = "",
    where: Location | None = None,
) -> Node:
    """The tree of `text`, whose names have `types` and whose value has the type `wanted`.

    `what` is its name in messages, e.g. "the rate of level", and `why` the origin of its dimension.

    Raises
    ------
    RigctlError
        it is not valid in the grammar, branches, uses an unknown name, or has another dimension.
    """
    location = where or Location()
    refuse_branch_words(text, location)
    expression = parse(text, location, functions=ALL_FUNCTIONS)
    refuse_corners(expression)
    actual = expression.check(types)
    if actual.dimension != wanted.dimension:
        raise RigctlError(
            f"{what} is {actual} [{actual.dimension}]",
            value=text,
            expected=f"{wanted} [{wanted.dimension}]{why and ', '}{why}",
            where=location,
        )
    tree = expression.checked(types, expected=wanted).resolved
    assert tree is not None  # noqa: S101 - a checked expression is resolved
    return tree
