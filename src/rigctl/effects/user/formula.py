"""From the text of a term to a formula of the model's symbols."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

from rigctl.effects.declaration import EffectParameter, Own, Term
from rigctl.effects.user.corners import refuse_branch_words, refuse_corners
from rigctl.effects.user.names import slot_type, term_types
from rigctl.engine import symbols
from rigctl.engine.symbols import Expr, Scalar
from rigctl.errors import Location, RigctlError
from rigctl.expressions import parse
from rigctl.expressions.functions import ALL_FUNCTIONS, divide
from rigctl.expressions.nodes import Binary, Call, Constant, Name, Negative, Node
from rigctl.physics.family import ModelFamily, Slot
from rigctl.physics.scope import Scope
from rigctl.units import describe

#: what a name in a term stands for
_LookUp: TypeAlias = Callable[[str], Scalar]

_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sqrt": symbols.sqrt,
    "exp": symbols.exp,
    "log": symbols.log,
    "tanh": symbols.tanh,
    "absolute": symbols.absolute,
    "positive_part": symbols.positive_part,
    "minimum": symbols.minimum,
    "maximum": symbols.maximum,
    "smooth_sign": symbols.smooth_sign,
    "smooth_step": symbols.smooth_step,
}


def read_term(
    text: str,
    family: ModelFamily,
    slot: Slot,
    parameters: Sequence[EffectParameter],
    where: Location | None = None,
) -> Term:
    """The formula that `text` is.

    Raises
    ------
    RigctlError
        it is none of the grammar, branches, names what there is not, or has another dimension than the slot.
    """
    place = where or Location()
    refuse_branch_words(text, place)
    expression = parse(text, place, functions=ALL_FUNCTIONS)
    refuse_corners(expression)
    types = term_types(family, slot, parameters)
    found, wanted = expression.check(types), slot_type(slot)
    if found.dimension != wanted.dimension:
        raise RigctlError(
            f"the term at {slot.name} is {found} [{found.dimension}]",
            value=text,
            expected=f"{_wanted(slot)} [{wanted.dimension}], as every term there",
            where=place,
        )
    tree = expression.checked(types, expected=wanted).resolved
    assert tree is not None  # noqa: S101 - a checked expression is resolved
    own = frozenset(parameter.name for parameter in parameters)
    return _as_term(tree, own)


def _wanted(slot: Slot) -> str:
    if slot.combine == "product":
        return "a factor, which is a plain number"
    return describe(slot.unit, difference=True).partition(", e.g.")[0]


def _as_term(tree: Node, own: frozenset[str]) -> Term:
    def term(m: Scope, p: Own) -> Scalar:
        def look_up(name: str) -> Scalar:
            if name in own:
                return p[name]
            return math.pi if name == "pi" else m[name]

        def number(constant: Constant) -> Scalar:
            unit = "*".join(str(constant.dimension).split(" "))
            return m.constant(constant.value, unit)

        return lower(tree, look_up, number)

    return term


def lower(node: Node, look_up: _LookUp, number: Callable[[Constant], Scalar]) -> Scalar:
    """A checked tree in the engine's symbols, or in plain numbers when the names stand for numbers."""
    match node:
        case Constant():
            return number(node)
        case Name(name):
            return look_up(name)
        case Negative(operand):
            return -lower(operand, look_up, number)
        case Binary(operator, left, right):
            return _binary(operator, lower(left, look_up, number), lower(right, look_up, number))
        case Call(function, arguments):
            result: Scalar = _FUNCTIONS[function](*(lower(each, look_up, number) for each in arguments))
            return result
        case _:
            raise TypeError(f"not a checked term: {node}")


def _binary(operator: str, left: Scalar, right: Scalar) -> Scalar:
    match operator:
        case "+":
            return left + right
        case "-":
            return left - right
        case "*":
            return left * right
        case "/":
            both_plain = not isinstance(left, Expr) and not isinstance(right, Expr)
            return divide(left, right) if both_plain else left / right  # type: ignore[arg-type]
        case _:
            return symbols.power(left, right)
