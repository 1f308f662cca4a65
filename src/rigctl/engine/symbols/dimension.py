"""The dimension of an expression, found from those of its variables and constants."""

from __future__ import annotations

from fractions import Fraction

from rigctl.engine.symbols.expr import Expr
from rigctl.errors import RigctlError
from rigctl.units import DIMENSIONLESS, Dimension


def dimension_of(expr: Expr) -> Dimension:
    """The dimension of `expr`; numbers are dimensionless, and exact 0 fits any dimension.

    Raises
    ------
    RigctlError
        a sum of two dimensions, or a function of an argument that is not dimensionless; it names the
        operation, both sides and both dimensions.
    """
    return _dimension(expr) or DIMENSIONLESS


def check_dimension(expr: Expr, expected: Dimension, what: str) -> None:
    """Require that `expr`, called `what` in the message, has the dimension `expected`.

    Raises
    ------
    RigctlError
        it has another dimension, or none that is consistent.
    """
    dimension = _dimension(expr)
    if dimension is not None and dimension != expected:
        raise RigctlError(
            f"{what} has the dimension [{dimension}]",
            value=repr(expr),
            expected=f"the dimension [{expected}]",
        )


def _dimension(expr: Expr) -> Dimension | None:
    """The dimension; None for exact zero, which fits any dimension."""
    known = expr.graph.dimensions
    if expr.index not in known:
        for node in expr.graph.reachable([expr], known):
            known[node.index] = _of_node(node, known)
    return known[expr.index]


def _of_node(node: Expr, known: dict[int, Dimension | None]) -> Dimension | None:
    parts = [known[arg.index] for arg in node.args]
    match node.op:
        case "variable":
            return node.declared
        case "constant":
            return node.declared if node.value else None
        case "+" | "-":
            return _sum(node, parts[0], parts[1])
        case "negative":
            return parts[0]
        case "*":
            return (parts[0] or DIMENSIONLESS) * (parts[1] or DIMENSIONLESS)
        case "/":
            return (parts[0] or DIMENSIONLESS) / (parts[1] or DIMENSIONLESS)
        case "power":
            return _raised(node, parts[0] or DIMENSIONLESS)
        case "sqrt":
            return (parts[0] or DIMENSIONLESS) ** Fraction(1, 2)
        case _:
            return _pure(node, parts[0] or DIMENSIONLESS)


def _sum(node: Expr, left: Dimension | None, right: Dimension | None) -> Dimension | None:
    if left is None or right is None:
        return left or right
    if left != right:
        verb = "adds" if node.op == "+" else "subtracts"
        raise RigctlError(
            f"an equation {verb} quantities of two dimensions, [{left}] and [{right}]",
            value=f"{_brief(node.args[0])} {node.op} {_brief(node.args[1])}",
            expected="terms of one dimension",
        )
    return left


def _pure(node: Expr, dimension: Dimension) -> Dimension:
    if not dimension.dimensionless:
        raise RigctlError(
            f"{node.op} of a quantity with the dimension [{dimension}]",
            value=f"{node.op}({_brief(node.args[0])})",
            expected="a dimensionless argument",
        )
    return DIMENSIONLESS


def _raised(node: Expr, dimension: Dimension) -> Dimension:
    if dimension.dimensionless:
        return DIMENSIONLESS
    if not isinstance(node.value, Fraction):
        raise RigctlError(
            f"a quantity with the dimension [{dimension}] is raised to a power that is no simple fraction",
            value=f"({_brief(node.args[0])}) ** {node.value:g}",
            expected="a dimensionless base",
        )
    return dimension**node.value


def _brief(expr: Expr) -> str:
    """One side of an operation, short enough that the other side still fits in the message."""
    from rigctl.engine.symbols.printing import to_text

    text = to_text(expr)
    return text if len(text) <= 28 else text[:27] + "…"
