"""A hash-consed graph of expressions: equal subexpressions are one node.

Nodes are numbered in the order in which they are created, so that the arguments of a node precede it, and
every traversal of the graph is a loop over sorted numbers rather than a recursion.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from numbers import Real
from typing import TypeAlias

from rigctl.engine.symbols.expr import Expr, Scalar, varying_exponent
from rigctl.errors import RigctlError
from rigctl.units import DIMENSIONLESS, Dimension

_LARGEST_DENOMINATOR = 64

#: a node as it is pickled: operation, numbers of its arguments, value, name, declared dimension
_Flat: TypeAlias = tuple[str, tuple[int, ...], float | Fraction, str, Dimension]


class Graph:
    """The expressions of one model. Every node is created here, simplified and shared.

    The rules of simplification are few and cheap (constants are folded, 0 and 1 are removed, signs are moved
    outwards): a model of thousands of nodes is built in milliseconds.
    """

    def __init__(self) -> None:
        self.nodes: list[Expr] = []
        self.variables: dict[str, Expr] = {}
        self.derivatives: dict[tuple[int, int], Expr] = {}
        self.dimensions: dict[int, Dimension | None] = {}
        self._nodes_by_key: dict[tuple[object, ...], Expr] = {}

    def variable(self, name: str, dimension: Dimension) -> Expr:
        """The variable `name`; the same node at every call.

        Raises
        ------
        RigctlError
            the name is already taken by a variable of another dimension.
        """
        known = self.variables.get(name)
        if known is None:
            known = self._append(Expr(self, "variable", (), 0.0, name, dimension))
            known.depends_on = 1 << len(self.variables)
            self.variables[name] = known
        elif known.declared != dimension:
            raise RigctlError(
                f"variable {name!r} already has the dimension [{known.declared}]", value=str(dimension)
            )
        return known

    def constant(self, value: float, dimension: Dimension = DIMENSIONLESS) -> Expr:
        """A number in SI, with its dimension.

        Raises
        ------
        RigctlError
            the number is not finite.
        """
        number = float(value)
        if not math.isfinite(number):
            raise RigctlError("a constant of an equation must be finite", value=str(value))
        # -0.0 and 0.0 are one key of a dictionary and must be one number
        number = number + 0.0 if number else 0.0
        return self._make("constant", (), number, dimension)

    def expression(self, value: object) -> Expr:
        """`value` itself when it belongs to this graph; a dimensionless constant when it is a number.

        Raises
        ------
        RigctlError
            it belongs to another graph, or is neither an expression nor a number.
        """
        if isinstance(value, Expr):
            if value.graph is not self:
                raise RigctlError("expressions of two models cannot be mixed", value=repr(value))
            return value
        if not isinstance(value, Real):
            raise RigctlError("not part of an equation", value=repr(value), expected="a number")
        return self.constant(float(value))

    def add(self, a: Expr, b: Expr) -> Expr:
        """A + b."""
        if _zero(a):
            return b
        if _zero(b):
            return a
        if a.constant and b.constant and a.declared == b.declared:
            return self.constant(float(a.value) + float(b.value), a.declared)
        if b.op == "negative":
            return self.subtract(a, b.args[0])
        if a.op == "negative":
            return self.subtract(b, a.args[0])
        return self._make("+", _ordered(a, b))

    def subtract(self, a: Expr, b: Expr) -> Expr:
        """A - b."""
        if _zero(b):
            return a
        if _zero(a):
            return self.negative(b)
        if a is b:
            return self.constant(0.0)
        if a.constant and b.constant and a.declared == b.declared:
            return self.constant(float(a.value) - float(b.value), a.declared)
        if b.op == "negative":
            return self.add(a, b.args[0])
        if a.op == "negative":
            # signs move outwards, so that -u - v and -v - u are one node; exact in IEEE arithmetic
            return self.negative(self.add(a.args[0], b))
        return self._make("-", (a, b))

    def negative(self, a: Expr) -> Expr:
        """-a."""
        if a.constant:
            return self.constant(-float(a.value), a.declared)
        if a.op == "negative":
            return a.args[0]
        if a.op == "-":
            return self._make("-", (a.args[1], a.args[0]))
        return self._make("negative", (a,))

    def multiply(self, a: Expr, b: Expr) -> Expr:
        """A * b."""
        if b.constant:
            a, b = b, a
        if a.constant:
            scaled = self._scale(a, b)
            if scaled is not None:
                return scaled
        if a.op == "negative":
            return self.negative(self.multiply(a.args[0], b))
        if b.op == "negative":
            return self.negative(self.multiply(a, b.args[0]))
        if a is b:
            return self.power(a, 2)
        return self._make("*", _ordered(a, b))

    def _scale(self, factor: Expr, b: Expr) -> Expr | None:
        """The simpler form of ``factor * b`` for a constant `factor`, if there is one."""
        if _zero(factor) or _zero(b):
            return self.constant(0.0)
        if b.constant:
            return self.constant(float(factor.value) * float(b.value), factor.declared * b.declared)
        if factor.declared == DIMENSIONLESS and factor.value == 1.0:
            return b
        if factor.declared == DIMENSIONLESS and factor.value == -1.0:
            return self.negative(b)
        if b.op == "*":
            inner = next((arg for arg in b.args if arg.constant), None)
            if inner is not None:
                rest = b.args[1] if b.args[0] is inner else b.args[0]
                return self.multiply(self.multiply(factor, inner), rest)
        return None

    def divide(self, a: Expr, b: Expr) -> Expr:
        """A / b.

        Raises
        ------
        RigctlError
            b is the number 0.
        """
        if _zero(b):
            raise RigctlError("an equation divides by zero", value=f"{a!r} / 0")
        if _zero(a):
            return self.constant(0.0)
        if b.constant:
            return self.multiply(self.constant(1.0 / float(b.value), DIMENSIONLESS / b.declared), a)
        if a is b:
            return self.constant(1.0)
        if a.op == "negative":
            return self.negative(self.divide(a.args[0], b))
        if b.op == "negative":
            return self.negative(self.divide(a, b.args[0]))
        return self._make("/", (a, b))

    def power(self, a: Expr, exponent: Scalar | Fraction) -> Expr:
        """``a ** exponent`` for a fixed number `exponent`, kept as a fraction where it is one.

        Raises
        ------
        RigctlError
            the exponent is an expression (see `symbols.power`), or zero is raised to a negative power.
        """
        if isinstance(exponent, Expr):
            if not exponent.constant:
                raise varying_exponent(exponent)
            exponent = exponent.value
        number = _exact(exponent)
        if number == 0:
            return self.constant(1.0)
        if number == 1:
            return a
        if number == Fraction(1, 2):
            return self.function("sqrt", a)
        if a.constant:
            if _zero(a) and number < 0:
                raise RigctlError("an equation divides by zero", value=f"0 ** {exponent}")
            if a.declared == DIMENSIONLESS or isinstance(number, Fraction):
                value = _real_power(float(a.value), number)
                return self.constant(value, a.declared ** Fraction(number) if number else DIMENSIONLESS)
        if a.op == "power" and isinstance(number, Fraction) and number.denominator == 1:
            return self.power(a.args[0], a.value * number)
        if a.op == "negative" and isinstance(number, Fraction) and number.denominator == 1:
            raised = self.power(a.args[0], number)
            return self.negative(raised) if number.numerator % 2 else raised
        return self._make("power", (a,), number)

    def function(self, name: str, a: Expr) -> Expr:
        """Apply the function `name` of `FUNCTIONS` to a."""
        if a.constant and (name == "sqrt" or a.declared == DIMENSIONLESS):
            value = float(a.value)
            if (name == "log" and value <= 0.0) or (name == "sqrt" and value < 0.0):
                raise RigctlError(f"{name} of a number that is not positive", value=str(value))
            dimension = a.declared ** Fraction(1, 2) if name == "sqrt" else DIMENSIONLESS
            try:
                return self.constant(getattr(math, name)(value), dimension)
            except OverflowError as problem:
                raise RigctlError(f"{name} of a number that is too large", value=str(value)) from problem
        return self._make(name, (a,))

    def reachable(self, roots: Iterable[Expr], known: Iterable[int] = ()) -> Sequence[Expr]:
        """All nodes on which `roots` depend, arguments first; those numbered in `known` are not followed."""
        visited: set[int] = set()
        skip = known if isinstance(known, set | dict) else set(known)
        waiting = list(roots)
        while waiting:
            node = waiting.pop()
            if node.index not in visited and node.index not in skip:
                visited.add(node.index)
                waiting.extend(node.args)
        return [self.nodes[index] for index in sorted(visited)]

    def _make(
        self,
        op: str,
        args: tuple[Expr, ...],
        value: float | Fraction = 0.0,
        declared: Dimension = DIMENSIONLESS,
    ) -> Expr:
        key = (op, value, declared if op == "constant" else None, *[arg.index for arg in args])
        node = self._nodes_by_key.get(key)
        if node is None:
            node = self._append(Expr(self, op, args, value, "", declared))
            self._nodes_by_key[key] = node
        return node

    def _append(self, node: Expr) -> Expr:
        self.nodes.append(node)
        return node

    def __getstate__(self) -> list[_Flat]:
        return [
            (node.op, tuple(arg.index for arg in node.args), node.value, node.name, node.declared)
            for node in self.nodes
        ]

    def __setstate__(self, state: list[_Flat]) -> None:
        Graph.__init__(self)
        for op, args, value, name, declared in state:
            if op == "variable":
                self.variable(name, declared)
            else:
                self._make(op, tuple(self.nodes[index] for index in args), value, declared)


def _zero(a: Expr) -> bool:
    return a.op == "constant" and a.value == 0.0


def _ordered(a: Expr, b: Expr) -> tuple[Expr, Expr]:
    return (a, b) if a.index <= b.index else (b, a)


def _exact(exponent: float | Fraction) -> float | Fraction:
    """The exponent as a fraction if it is one with a small denominator, else the float itself."""
    fraction = Fraction(exponent).limit_denominator(_LARGEST_DENOMINATOR)
    return fraction if abs(float(fraction) - float(exponent)) < 1e-14 else float(exponent)


def _real_power(base: float, exponent: float | Fraction) -> float:
    if base < 0.0 and Fraction(exponent).denominator != 1:
        raise RigctlError("a negative number has no real root", value=f"{base} ** {exponent}")
    return float(base ** (int(exponent) if Fraction(exponent).denominator == 1 else float(exponent)))
