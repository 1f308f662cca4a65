"""Substitution in an expression, and the variables on which it depends."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.engine.symbols.expr import Expr, Scalar


def substitute(expr: Expr, replacements: Mapping[Expr, Scalar]) -> Expr:
    """`expr` with each variable of `replacements` replaced, all at once, and simplified again.

    Any other node may be replaced too, wherever it occurs as a whole. Dimensions are not checked here; use
    `dimension_of` on the result.
    """
    graph = expr.graph
    done = {variable.index: graph.expression(value) for variable, value in replacements.items()}
    for node in graph.reachable([expr], done):
        done[node.index] = _rebuilt(node, [done[arg.index] for arg in node.args])
    return done[expr.index]


def variables_of(expr: Expr) -> tuple[Expr, ...]:
    """The variables on which `expr` depends, in the order of their creation."""
    return tuple(v for v in expr.graph.variables.values() if v.depends_on & expr.depends_on)


def _rebuilt(node: Expr, args: list[Expr]) -> Expr:
    if all(new is old for new, old in zip(args, node.args, strict=True)):
        return node
    graph = node.graph
    match node.op:
        case "+":
            return graph.add(args[0], args[1])
        case "-":
            return graph.subtract(args[0], args[1])
        case "*":
            return graph.multiply(args[0], args[1])
        case "/":
            return graph.divide(args[0], args[1])
        case "negative":
            return graph.negative(args[0])
        case "power":
            return graph.power(args[0], node.value)
        case _:
            return graph.function(node.op, args[0])
