"""Functions without a derivative, which formulas may not use, each with its smooth alternative."""

from __future__ import annotations

import re

from rigctl.errors import Location, RigctlError
from rigctl.expressions import Expression
from rigctl.expressions.nodes import Call, Comparison, Logic, Node, Not, Variable, walk

_STEP = "Write smooth_step(x - limit, width), which goes from 0 to 1 within about the width"
_SIGN = "Write smooth_sign(x, width), or tanh(x/width)"

#: functions with a corner or a jump, and what to write instead
_INSTEAD = {
    "abs": "Write absolute(x, width)",
    "min": "Write minimum(a, b, width)",
    "max": "Write positive_part(x, width) for max(x, 0), or maximum(a, b, width)",
    "if": _STEP,
    "where": _STEP,
    "step": _STEP,
    "heaviside": _STEP,
    "sign": _SIGN,
    "sgn": _SIGN,
    "clip": "Write minimum(maximum(x, low, width), high, width)",
    "floor": _STEP,
    "ceil": _STEP,
    "round": _STEP,
}

_CALLED = re.compile(r"([^\W\d]\w*)\s*\(")
_BRANCH = re.compile(r"\b(if|else|then|elif)\b|\?")


def refuse_branch_words(text: str, where: Location) -> None:
    """Refuse the keywords of branches in other languages, which the parser would report only as misplaced.

    Raises
    ------
    RigctlError
        there is such a word, or a function with a corner; the hint gives the smooth alternative.
    """
    for called in _CALLED.finditer(text):
        name = called.group(1).casefold()
        if name in _INSTEAD:
            raise _corner(f"'{called.group(1)}' has a corner or a jump", text, _INSTEAD[name], where)
    if branch := _BRANCH.search(text):
        raise _corner(f"a formula may not branch: '{branch.group()}'", text, _STEP, where)


def refuse_corners(expression: Expression) -> None:
    """Refuse comparisons and logic, and the variables of procedures.

    Raises
    ------
    RigctlError
        there is one; the hint gives the smooth alternative.
    """
    for node in walk(expression.root):
        if isinstance(node, Comparison | Logic | Not):
            raise _corner(
                f"a formula may not branch: {_named(node)}", expression.text, _STEP, expression.where
            )
        if isinstance(node, Variable):
            raise RigctlError(
                "variables with a dollar belong to procedures",
                value=f"${node.name}",
                expected="a variable or a parameter of the model",
                where=expression.where,
            )
        if isinstance(node, Call) and node.function in _INSTEAD:
            what = f"'{node.function}' has a corner"
            raise _corner(what, expression.text, _INSTEAD[node.function], expression.where)


def _named(node: Node) -> str:
    if isinstance(node, Comparison):
        return f"the comparison '{node.operators[0]}' jumps"
    return f"'{node.operator}'" if isinstance(node, Logic) else "'not'"


def _corner(what: str, text: str, instead: str, where: Location) -> RigctlError:
    return RigctlError(
        what, value=text, expected="a smooth formula, as the solver needs", hint=instead, where=where
    )
