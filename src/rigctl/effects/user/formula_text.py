"""The formula of an expression in the grammar of effect files: every number with its unit."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from fractions import Fraction

from rigctl.engine.symbols import Expr
from rigctl.engine.symbols.printing import ATOM, POWER, Printed, Printer
from rigctl.units import DIMENSIONLESS, Dimension

_FUNCTIONS = frozenset({"exp", "log", "sqrt", "tanh", "sin", "cos"})


def formula_text(expr: Expr, names: Mapping[str, str], points: Collection[str] = ()) -> str:
    """One line that `rigctl.effects.user.formula.read_term` reads as the same expression.

    Parameters
    ----------
    names: names of variables in the file, if different from their own.
    points: absolute temperatures; ``(temperature - 0 K)`` may be multiplied.

    Raises
    ------
    TypeError
        the expression has an operation that the grammar does not have.
    """
    return _Grammar(names, points).text(expr)


def number_text(value: float, dimension: Dimension = DIMENSIONLESS) -> str:
    """``0.05 kg*m^-1``: a number in SI with its unit, in twelve digits unless these lose something."""
    digits = f"{value:.12g}"
    digits = digits if abs(float(digits) - value) <= 1e-14 * abs(value) else repr(value)
    unit = "*".join(str(dimension).split(" "))
    return digits if unit == "1" else f"{digits} {unit}"


class _Grammar(Printer):
    def __init__(self, names: Mapping[str, str], points: Collection[str]) -> None:
        self._names = names
        self._points = points

    def constant(self, node: Expr) -> Printed:
        text = number_text(float(node.value), node.declared)
        return text if node.value >= 0 and " " not in text else f"({text})", ATOM

    def variable(self, node: Expr) -> Printed:
        name = self._names.get(node.name, node.name)
        return f"({name} - 0 K)" if node.name in self._points else name, ATOM

    def negative(self, part: Printed) -> Printed:
        return f"(-{self.within(part, POWER)})", ATOM

    def power(self, base: Printed, node: Expr) -> Printed:
        value = node.value
        natural = isinstance(value, Fraction) and value.denominator == 1 and value > 0
        exponent = str(value) if natural else f"({number_text(float(value))})"
        return f"{self.within(base, ATOM)}^{exponent}", POWER

    def call(self, function: str, argument: str) -> Printed:
        if function not in _FUNCTIONS:
            raise TypeError(f"not in the grammar: {function}")
        return f"{function}({argument})", ATOM
