"""A node of the graph of expressions, and its arithmetic operators.

In: Python code that computes with variables, such as the equations of a family. Out: nodes of a `Graph`,
one for each operation; equal expressions are one object, so that common parts are found by identity.

Comparisons raise an error, because the code runs once, when the graph is built: an `if` on a state would
be decided then, for all times. Smooth switches take its place. A node is pickled by its number in the
graph, since its arguments would be pickled recursively, as deep as the expression.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Never, TypeAlias

from rigctl.errors import RigctlError
from rigctl.units import Dimension

if TYPE_CHECKING:
    from rigctl.engine.symbols.graph import Graph

#: the one-argument functions a node can be
FUNCTIONS = ("exp", "log", "sqrt", "tanh", "sin", "cos")

_SMOOTH_ALTERNATIVES = "use a smooth switch: positive_part, absolute, minimum, maximum, smooth_step or tanh"


class Expr:
    """A node of a `Graph`: an operation, its arguments, and the data of a constant, variable or power.

    Two expressions of one graph are equal exactly when they are the same object.

    Attributes
    ----------
    graph: the graph that owns the node.
    index: its number in that graph; larger than those of its arguments.
    op: "constant", "variable", "+", "-", "*", "/", "negative", "power" or one of `FUNCTIONS`.
    args: its arguments.
    value: of a constant its number, of a power its exponent, else 0.
    name: of a variable its name, else "".
    depends_on: a bit for each variable of the graph that it depends on.
    """

    __slots__ = ("args", "declared", "depends_on", "graph", "index", "name", "op", "value")

    def __init__(
        self,
        graph: Graph,
        op: str,
        args: tuple[Expr, ...],
        value: float | Fraction,
        name: str,
        declared: Dimension,
    ) -> None:
        self.graph = graph
        self.index = len(graph.nodes)
        self.op = op
        self.args = args
        self.value = value
        self.name = name
        self.declared = declared
        self.depends_on = 0
        for arg in args:
            self.depends_on |= arg.depends_on

    @property
    def constant(self) -> bool:
        """True for a number."""
        return self.op == "constant"

    def __add__(self, other: Scalar) -> Expr:
        return self.graph.add(self, self.graph.expression(other))

    def __radd__(self, other: float) -> Expr:
        return self.graph.add(self.graph.expression(other), self)

    def __sub__(self, other: Scalar) -> Expr:
        return self.graph.subtract(self, self.graph.expression(other))

    def __rsub__(self, other: float) -> Expr:
        return self.graph.subtract(self.graph.expression(other), self)

    def __mul__(self, other: Scalar) -> Expr:
        return self.graph.multiply(self, self.graph.expression(other))

    def __rmul__(self, other: float) -> Expr:
        return self.graph.multiply(self.graph.expression(other), self)

    def __truediv__(self, other: Scalar) -> Expr:
        return self.graph.divide(self, self.graph.expression(other))

    def __rtruediv__(self, other: float) -> Expr:
        return self.graph.divide(self.graph.expression(other), self)

    def __neg__(self) -> Expr:
        return self.graph.negative(self)

    def __pos__(self) -> Expr:
        return self

    def __pow__(self, exponent: Scalar | Fraction) -> Expr:
        return self.graph.power(self, exponent)

    def __rpow__(self, base: float) -> Never:
        raise varying_exponent(self)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """numpy's functions of symbols: see `rigctl.engine.symbols.numpy_functions`."""
        from rigctl.engine.symbols.numpy_functions import of_symbols

        return of_symbols(ufunc, method, inputs, options)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, int | float):
            self._no_branch()
        return self is other

    __hash__ = object.__hash__

    def __lt__(self, other: Scalar) -> Never:
        self._no_branch()

    __le__ = __gt__ = __ge__ = __lt__

    def __bool__(self) -> bool:  # noqa: PLE0304
        self._no_branch()

    def __abs__(self) -> Never:
        self._no_branch()

    def __float__(self) -> float:
        if self.constant:
            return float(self.value)
        raise RigctlError(
            "an expression is not a number",
            value=repr(self),
            hint="Take numpy's functions where math's were called; evaluate(expr, values) gives a number",
        )

    def __repr__(self) -> str:
        from rigctl.engine.symbols.printing import to_text

        return to_text(self)

    def __reduce__(self) -> tuple[Callable[[Graph, int], Expr], tuple[Graph, int]]:
        # a node by its number: pickling its arguments would recurse as deep as the expression
        return _node_of, (self.graph, self.index)

    def _no_branch(self) -> Never:
        raise RigctlError(
            "an equation may not branch on a state or a parameter",
            value=repr(self),
            hint=_SMOOTH_ALTERNATIVES,
        )


#: argument and result of a physical term: an expression, or a plain number when it is tested by itself
Scalar: TypeAlias = Expr | float


def _node_of(graph: Graph, index: int) -> Expr:
    return graph.nodes[index]


def varying_exponent(exponent: Expr) -> RigctlError:
    """The error for ``x ** y`` with an expression y."""
    return RigctlError(
        "the exponent of ** may not be an expression",
        value=repr(exponent),
        hint="use power(x, y) or exp(y*log(x))",
    )
