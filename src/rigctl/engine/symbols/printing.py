"""Expressions as text: one line in the syntax of Python, LaTeX, or another dialect of `Printer`.

In: an expression. Out: its text, for people and for files that are read again; code that is compiled is
made elsewhere, with a line for each node, as common parts are written out here wherever they occur.

Brackets follow from precedence alone, and arguments are put into the order of reading: the graph keeps
those of sums and products in an order of its own, so that `x*y` and `y*x` are one node. Numbers have
twelve digits, or all of them where twelve would read as another number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import TypeAlias

from rigctl.engine.symbols.expr import Expr

# precedence of operations: sums, products, powers, atoms
SUM, PRODUCT, POWER, ATOM = 1, 2, 3, 4

_GREEK = re.compile(
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|pi|rho|sigma|tau|phi|chi|psi|omega"
    "|Gamma|Delta|Theta|Lambda|Xi|Pi|Sigma|Phi|Psi|Omega"
)

#: the text of a part, and the precedence of its outermost operation
Printed: TypeAlias = tuple[str, int]


def to_text(expr: Expr) -> str:
    """One line in the syntax of Python: ``k*(pressure_a - pressure_b)/viscosity``."""
    return Printer().text(expr)


def to_latex(expr: Expr, names: Mapping[str, str] | None = None) -> str:
    """`expr` in LaTeX, without dollar signs; `names` gives the LaTeX of variables with special symbols.

    Other names are converted: ``mu`` to a Greek letter, ``p_a`` to a subscript, a word to upright type.
    """
    return _Latex(names or {}).text(expr)


class Printer:
    """Writes expressions with no more brackets than necessary, in the syntax of Python.

    A subclass for another dialect overrides the methods that differ.
    """

    brackets = ("(", ")")
    times = "*"

    def text(self, expr: Expr) -> str:
        """The text of `expr`; shared subexpressions are written out wherever they occur."""
        done: dict[int, Printed] = {}
        for node in expr.graph.reachable([expr]):
            done[node.index] = self._node(node, [done[arg.index] for arg in _in_reading_order(node)])
        return done[expr.index][0]

    def constant(self, node: Expr) -> Printed:
        """A number."""
        return number_digits(float(node.value)), ATOM if node.value >= 0 else SUM

    def variable(self, node: Expr) -> Printed:
        """A variable's name."""
        return node.name, ATOM

    def negative(self, part: Printed) -> Printed:
        """The negative of a part."""
        return f"-{self.within(part, PRODUCT)}", SUM

    def quotient(self, above: Printed, below: Printed) -> Printed:
        """One part divided by another."""
        return f"{self.within(above, PRODUCT)}/{self.within(below, POWER)}", PRODUCT

    def power(self, base: Printed, node: Expr) -> Printed:
        """A power of `base` with the exponent of `node`."""
        exponent = plain_exponent(node)
        safe = exponent if re.fullmatch(r"[\d.]+", exponent) else f"({exponent})"
        return f"{self.within(base, ATOM)}**{safe}", POWER

    def call(self, function: str, argument: str) -> Printed:
        """A function of an argument."""
        return f"{function}({argument})", ATOM

    def within(self, part: Printed, level: int) -> str:
        """A part, in brackets unless its precedence is at least `level`."""
        text, binds = part
        return text if binds >= level else f"{self.brackets[0]}{text}{self.brackets[1]}"

    def _node(self, node: Expr, args: list[Printed]) -> Printed:
        match node.op:
            case "constant":
                return self.constant(node)
            case "variable":
                return self.variable(node)
            case "+":
                return f"{args[0][0]} + {self.within(args[1], SUM + args[1][0].startswith('-'))}", SUM
            case "-":
                return f"{args[0][0]} - {self.within(args[1], PRODUCT)}", SUM
            case "*":
                return self.times.join(self.within(part, PRODUCT) for part in args), PRODUCT
            case "/":
                return self.quotient(*args)
            case "negative":
                return self.negative(args[0])
            case "power":
                return self.power(args[0], node)
            case function:
                return self.call(function, args[0][0])


class _Latex(Printer):
    brackets = (r"\left(", r"\right)")
    times = r" \, "

    def __init__(self, names: Mapping[str, str]) -> None:
        self._names = names

    def constant(self, node: Expr) -> Printed:
        mantissa, _, exponent = number_digits(float(node.value)).partition("e")
        text = mantissa if not exponent else rf"{mantissa} \cdot 10^{{{int(exponent)}}}"
        return text, SUM if node.value < 0 else ATOM if not exponent else PRODUCT

    def variable(self, node: Expr) -> Printed:
        return self._names.get(node.name) or _latex_name(node.name), ATOM

    def quotient(self, above: Printed, below: Printed) -> Printed:
        return rf"\frac{{{above[0]}}}{{{below[0]}}}", POWER

    def power(self, base: Printed, node: Expr) -> Printed:
        return f"{self.within(base, ATOM)}^{{{plain_exponent(node)}}}", POWER

    def call(self, function: str, argument: str) -> Printed:
        if function == "sqrt":
            return rf"\sqrt{{{argument}}}", ATOM
        return rf"\{'ln' if function == 'log' else function}\left({argument}\right)", ATOM


def _in_reading_order(node: Expr) -> tuple[Expr, ...]:
    """The arguments, with numbers first in a product and last in a sum, whatever their order in the graph."""
    if len(node.args) == 2 and node.op in "*+":
        first, second = node.args
        if second.constant if node.op == "*" else first.constant:
            return second, first
    return node.args


def number_digits(value: float) -> str:
    """A number to twelve digits, or to all of them if twelve would lose information."""
    text = f"{value:.12g}"
    return text if float(text) == value else repr(value)


def plain_exponent(node: Expr) -> str:
    """The exponent of a power: ``1/3``, ``0.5``."""
    return str(node.value) if isinstance(node.value, Fraction) else number_digits(node.value)


def _latex_name(name: str) -> str:
    head, *subscripts = name.split("_")
    symbol = rf"\{head}" if _GREEK.fullmatch(head) else head
    if len(head) > 1 and not _GREEK.fullmatch(head):
        return rf"\mathrm{{{name}}}".replace("_", r"\_")
    return symbol + (rf"_{{\mathrm{{{','.join(subscripts)}}}}}" if subscripts else "")
