"""Numerical value of an expression: slow, for tests and for single values."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rigctl.engine.symbols import functions
from rigctl.engine.symbols.expr import Expr
from rigctl.errors import unknown_name


def evaluate(expr: Expr, values: Mapping[str, float]) -> float:
    """The value of `expr` for these values of its variables (SI); inf and nan as in IEEE arithmetic.

    Raises
    ------
    RigctlError
        a variable has no value.
    """
    numbers: dict[int, float] = {}
    for node in expr.graph.reachable([expr]):
        numbers[node.index] = _of_node(node, [numbers[arg.index] for arg in node.args], values)
    return numbers[expr.index]


def _of_node(node: Expr, args: list[float], values: Mapping[str, float]) -> float:
    match node.op:
        case "constant":
            return float(node.value)
        case "variable":
            if node.name not in values:
                raise unknown_name("variable in an equation", node.name, values)
            return float(values[node.name])
        case "+":
            return args[0] + args[1]
        case "-":
            return args[0] - args[1]
        case "*":
            return args[0] * args[1]
        case "/":
            return _quotient(args[0], args[1])
        case "negative":
            return -args[0]
        case "power":
            return functions.power(args[0], float(node.value))
        case "exp":
            return functions.exp(args[0])
        case "log":
            return functions.log(args[0])
        case "sqrt":
            return functions.sqrt(args[0])
        case "sin":
            return functions.sin(args[0])
        case "cos":
            return functions.cos(args[0])
        case _:
            return math.tanh(args[0])


def _quotient(a: float, b: float) -> float:
    if b != 0.0:
        return a / b
    return math.nan if a == 0.0 or math.isnan(a) else math.copysign(math.inf, a) * math.copysign(1.0, b)
