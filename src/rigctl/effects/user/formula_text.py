"""The formula of an expression in the grammar of effect files: every number with its unit."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from fractions import Fraction
from typing import TypeAlias

from rigctl.engine.symbols import Expr
from rigctl.units import DIMENSIONLESS, Dimension

_FUNCTIONS = frozenset({"exp", "log", "sqrt", "tanh", "sin", "cos"})
# how tightly an operation binds: sums, products, powers, atoms
_SUM, _PRODUCT, _POWER, _ATOM = 1, 2, 3, 4
_Printed: TypeAlias = tuple[str, int]


def formula_text(expr: Expr, names: Mapping[str, str], points: Collection[str] = ()) -> str:
    """One line that `rigctl.effects.user.formula.read_term` reads as the same expression.

    Parameters
    ----------
    names: what a variable is called in the file, where not by its own name.
    points: temperatures that are points on a scale; ``(temperature - 0 K)`` may be multiplied.

    Raises
    ------
    TypeError
        the expression has an operation that the grammar does not have.
    """
    done: dict[int, _Printed] = {}
    for node in expr.graph.reachable([expr]):
        done[node.index] = _text(node, [done[arg.index] for arg in node.args], names, points)
    return done[expr.index][0]


def number_text(value: float, dimension: Dimension = DIMENSIONLESS) -> str:
    """``0.05 kg*m^-1``: a number in SI with its unit, in twelve digits unless these lose something."""
    digits = f"{value:.12g}"
    digits = digits if abs(float(digits) - value) <= 1e-14 * abs(value) else repr(value)
    unit = "*".join(str(dimension).split(" "))
    return digits if unit == "1" else f"{digits} {unit}"


def _text(node: Expr, args: list[_Printed], names: Mapping[str, str], points: Collection[str]) -> _Printed:
    if node.op == "constant":
        text = number_text(float(node.value), node.declared)
        return (text, _ATOM) if node.value >= 0 and " " not in text else (f"({text})", _ATOM)
    if node.op == "variable":
        name = names.get(node.name, node.name)
        return (f"({name} - 0 K)" if node.name in points else name), _ATOM
    if node.op in _FUNCTIONS:
        return f"{node.op}({args[0][0]})", _ATOM
    return _operation(node, args)


def _operation(node: Expr, args: list[_Printed]) -> _Printed:
    match node.op:
        case "negative":
            return f"(-{_within(args[0], _POWER)})", _ATOM
        case "power":
            return f"{_within(args[0], _ATOM)}^{_exponent(node.value)}", _POWER
        case "+":
            return f"{args[0][0]} + {_within(args[1], _SUM)}", _SUM
        case "-":
            return f"{args[0][0]} - {_within(args[1], _PRODUCT)}", _SUM
        case "*":
            return f"{_within(args[0], _PRODUCT)}*{_within(args[1], _PRODUCT)}", _PRODUCT
        case "/":
            return f"{_within(args[0], _PRODUCT)}/{_within(args[1], _POWER)}", _PRODUCT
        case op:
            raise TypeError(f"not in the grammar: {op}")


def _exponent(value: float | Fraction) -> str:
    whole = isinstance(value, Fraction) and value.denominator == 1 and value > 0
    return str(value) if whole else f"({number_text(float(value))})"


def _within(part: _Printed, level: int) -> str:
    text, binds = part
    return text if binds >= level else f"({text})"
