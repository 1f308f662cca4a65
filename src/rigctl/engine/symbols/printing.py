"""Expressions as people read them: one line of text, or LaTeX."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction

from rigctl.engine.symbols.expr import Expr

# how tightly an operation binds: sums, products, powers, atoms
_SUM, _PRODUCT, _POWER, _ATOM = 1, 2, 3, 4

_GREEK = re.compile(
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|pi|rho|sigma|tau|phi|chi|psi|omega"
    "|Gamma|Delta|Theta|Lambda|Xi|Pi|Sigma|Phi|Psi|Omega"
)

Printed = tuple[str, int]


def to_text(expr: Expr) -> str:
    """One line in the syntax of a formula in a file: ``k*(pressure_a - pressure_b)/viscosity``."""
    done: dict[int, Printed] = {}
    for node in expr.graph.reachable([expr]):
        done[node.index] = _text(node, [done[arg.index] for arg in _in_reading_order(node)])
    return done[expr.index][0]


def to_latex(expr: Expr, names: Mapping[str, str] | None = None) -> str:
    """The LaTeX of `expr`, without dollar signs; `names` gives a variable's own LaTeX where it has one.

    Other names become symbols: ``mu`` a Greek letter, ``p_a`` a subscript, a word upright.
    """
    known = names or {}
    done: dict[int, Printed] = {}
    for node in expr.graph.reachable([expr]):
        done[node.index] = _latex(node, [done[arg.index] for arg in _in_reading_order(node)], known)
    return done[expr.index][0]


def _in_reading_order(node: Expr) -> tuple[Expr, ...]:
    """Numbers stand first in a product and last in a sum, whatever order the graph keeps them in."""
    if len(node.args) == 2 and node.op in "*+":
        first, second = node.args
        if second.constant if node.op == "*" else first.constant:
            return second, first
    return node.args


def _number(value: float) -> str:
    text = f"{value:.12g}"
    return text if float(text) == value else repr(value)


def _within(part: Printed, level: int, brackets: str = "()") -> str:
    text, binds = part
    return text if binds >= level else f"{brackets[0]}{text}{brackets[1]}"


def _text(node: Expr, args: list[Printed]) -> Printed:
    match node.op:
        case "constant":
            return _number(float(node.value)), _ATOM if node.value >= 0 else _SUM
        case "variable":
            return node.name, _ATOM
        case "+":
            return f"{args[0][0]} + {_within(args[1], _SUM + (args[1][0].startswith('-')))}", _SUM
        case "-":
            return f"{args[0][0]} - {_within(args[1], _PRODUCT)}", _SUM
        case "*":
            return f"{_within(args[0], _PRODUCT)}*{_within(args[1], _PRODUCT)}", _PRODUCT
        case "/":
            return f"{_within(args[0], _PRODUCT)}/{_within(args[1], _POWER)}", _PRODUCT
        case "negative":
            return f"-{_within(args[0], _PRODUCT)}", _SUM
        case "power":
            exponent = _exponent(node)
            safe = exponent if re.fullmatch(r"[\d.]+", exponent) else f"({exponent})"
            return f"{_within(args[0], _ATOM)}**{safe}", _POWER
        case _:
            return f"{node.op}({args[0][0]})", _ATOM


def _exponent(node: Expr) -> str:
    return str(node.value) if isinstance(node.value, Fraction) else _number(node.value)


def _latex(node: Expr, args: list[Printed], names: Mapping[str, str]) -> Printed:
    match node.op:
        case "constant":
            return _latex_number(float(node.value))
        case "variable":
            return names.get(node.name) or _latex_name(node.name), _ATOM
        case "+":
            return f"{args[0][0]} + {_latex_within(args[1], _SUM + (args[1][0].startswith('-')))}", _SUM
        case "-":
            return f"{args[0][0]} - {_latex_within(args[1], _PRODUCT)}", _SUM
        case "*":
            product = rf"{_latex_within(args[0], _PRODUCT)} \, {_latex_within(args[1], _PRODUCT)}"
            return product, _PRODUCT
        case "/":
            return rf"\frac{{{args[0][0]}}}{{{args[1][0]}}}", _POWER
        case "negative":
            return f"-{_latex_within(args[0], _PRODUCT)}", _SUM
        case "power":
            return f"{_latex_within(args[0], _ATOM)}^{{{_exponent(node)}}}", _POWER
        case "sqrt":
            return rf"\sqrt{{{args[0][0]}}}", _ATOM
        case "log":
            return rf"\ln\left({args[0][0]}\right)", _ATOM
        case _:
            return rf"\{node.op}\left({args[0][0]}\right)", _ATOM


def _latex_within(part: Printed, level: int) -> str:
    text, binds = part
    return text if binds >= level else rf"\left({text}\right)"


def _latex_number(value: float) -> Printed:
    mantissa, _, exponent = _number(value).partition("e")
    text = mantissa if not exponent else rf"{mantissa} \cdot 10^{{{int(exponent)}}}"
    return text, _SUM if value < 0 else _ATOM if not exponent else _PRODUCT


def _latex_name(name: str) -> str:
    head, *subscripts = name.split("_")
    symbol = rf"\{head}" if _GREEK.fullmatch(head) else head
    if len(head) > 1 and not _GREEK.fullmatch(head):
        return rf"\mathrm{{{name}}}".replace("_", r"\_")
    return symbol + (rf"_{{\mathrm{{{','.join(subscripts)}}}}}" if subscripts else "")
