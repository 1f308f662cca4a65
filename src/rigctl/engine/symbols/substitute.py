"""Replacing variables in an expression, and asking which ones it has."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.engine.symbols.expr import Expr, Scalar


def substitute(expr: Expr, replacements: Mapping[Expr, Scalar]) -> Expr:
    """`expr` with each variable of `replacements` replaced, all at once, and simplified again.

    Any other node may be replaced too, wherever it stands as a whole. The graph checks no dimension here;
    `dimension_of` the result does.
    """
    graph = expr.graph
    done = {variable.index: graph.expression(value) for variable, value in replacements.items()}
    for node in graph.reachable([expr], done):
        done[node.index] = _rebuilt(node, [done[arg.index] for arg in node.args])
    return done[expr.index]


def variables_of(expr: Expr) -> tuple[Expr, ...]:
    """The variables that `expr` depends on, in the order they were made."""
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
