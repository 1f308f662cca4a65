"""Exact derivatives of expressions, each computed once."""

from __future__ import annotations

from rigctl.engine.symbols.expr import Expr
from rigctl.errors import RigctlError


def derivative(expr: Expr, variable: Expr) -> Expr:
    """``∂expr/∂variable`` by the chain rule, simplified and shared; exactly 0 where there is no dependence.

    Raises
    ------
    RigctlError
        `variable` is not a variable of the same graph.
    """
    graph = expr.graph
    if variable.op != "variable" or variable.graph is not graph:
        raise RigctlError("a derivative is taken with respect to a variable", value=repr(variable))
    known = graph.derivatives
    zero = graph.constant(0.0)
    if not expr.depends_on & variable.depends_on:
        return zero
    cached = known.get((expr.index, variable.index))
    if cached is not None:
        return cached
    for node in _needed(expr, variable):
        known[node.index, variable.index] = _of_node(
            node,
            variable,
            [
                known[arg.index, variable.index] if arg.depends_on & variable.depends_on else zero
                for arg in node.args
            ],
        )
    return known[expr.index, variable.index]


def _needed(expr: Expr, variable: Expr) -> list[Expr]:
    """The nodes under `expr` that depend on `variable` and have no derivative yet, arguments first."""
    graph = expr.graph
    visited: set[int] = set()
    waiting = [expr]
    while waiting:
        node = waiting.pop()
        if (
            node.index in visited
            or not node.depends_on & variable.depends_on
            or (node.index, variable.index) in graph.derivatives
        ):
            continue
        visited.add(node.index)
        waiting.extend(node.args)
    return [graph.nodes[index] for index in sorted(visited)]


def _of_node(node: Expr, variable: Expr, parts: list[Expr]) -> Expr:
    args = node.args
    match node.op:
        case "variable":
            return node.graph.constant(1.0)
        case "+":
            return parts[0] + parts[1]
        case "-":
            return parts[0] - parts[1]
        case "negative":
            return -parts[0]
        case "*":
            return parts[0] * args[1] + args[0] * parts[1]
        case "/":
            return (parts[0] - node * parts[1]) / args[1]
        case "power":
            return float(node.value) * parts[0] * args[0] ** (node.value - 1)
        case "exp":
            return node * parts[0]
        case "log":
            return parts[0] / args[0]
        case "sqrt":
            return 0.5 * parts[0] / node
        case "sin":
            return node.graph.function("cos", args[0]) * parts[0]
        case "cos":
            return -node.graph.function("sin", args[0]) * parts[0]
        case "tanh":
            return (1.0 - node * node) * parts[0]
    raise RigctlError("an operation without a derivative", value=node.op)
