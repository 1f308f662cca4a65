"""Replace ``$variables`` by quantities."""

from __future__ import annotations

import re
from collections.abc import Mapping

from rigctl.expressions.nodes import Literal, Node, Variable, replace_leaves
from rigctl.units import Quantity

_VARIABLE = re.compile(r"\$([^\W\d]\w*)(\s*[\^*/])?")


def substitute(root: Node, values: Mapping[str, Quantity]) -> Node:
    """Return the tree with literals in place of the variables in `values`; the others are unchanged."""

    def leaf(node: Node) -> Node:
        if isinstance(node, Variable) and node.name in values:
            quantity = values[node.name]
            return Literal(quantity.value, quantity.unit)
        return node

    return replace_leaves(root, leaf)


def substitute_text(text: str, values: Mapping[str, Quantity]) -> str:
    """Return the text with the same replacements, in parentheses where a unit would run into an operator."""

    def written(match: re.Match[str]) -> str:
        name, operator = match.group(1), match.group(2) or ""
        if name not in values:
            return match.group()
        quantity = values[name]
        enclosed = operator or quantity.value < 0.0
        return (f"({quantity})" if enclosed else str(quantity)) + operator

    return _VARIABLE.sub(written, text)
