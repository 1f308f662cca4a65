"""Conversion of a checked tree to the engine's symbols."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from rigctl.engine import symbols
from rigctl.engine.symbols import Expr, Scalar
from rigctl.expressions.functions import divide
from rigctl.expressions.nodes import Binary, Call, Constant, Name, Negative, Node
from rigctl.physics.scope import Scope

#: meaning of a name in a formula
LookUp: TypeAlias = Callable[[str], Scalar]

_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sqrt": symbols.sqrt,
    "exp": symbols.exp,
    "log": symbols.log,
    "tanh": symbols.tanh,
    "sin": symbols.sin,
    "cos": symbols.cos,
    "absolute": symbols.absolute,
    "positive_part": symbols.positive_part,
    "minimum": symbols.minimum,
    "maximum": symbols.maximum,
    "smooth_sign": symbols.smooth_sign,
    "smooth_step": symbols.smooth_step,
    "spow": symbols.signed_power,
}


def lower(node: Node, m: Scope, look_up: LookUp) -> Scalar:  # noqa: PLR0911 - one for each kind
    """The value of a checked tree: symbols, or a plain number if the scope holds plain numbers.

    `look_up` returns the value of each name except ``pi``.
    """
    match node:
        case Constant(value, dimension):
            return m.constant(value, "*".join(str(dimension).split(" ")))
        case Name("pi"):
            return math.pi
        case Name(name):
            return look_up(name)
        case Negative(operand):
            return -lower(operand, m, look_up)
        case Binary(operator, left, right):
            return _binary(operator, lower(left, m, look_up), lower(right, m, look_up))
        case Call("table", (x, Name(name))):
            return m.table(name, lower(x, m, look_up))
        case Call(function, arguments):
            result: Scalar = _FUNCTIONS[function](*(lower(each, m, look_up) for each in arguments))
            return result
        case _:
            raise TypeError(f"not a checked formula: {node}")


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
