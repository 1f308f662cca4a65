"""A system as straight-line code: each subexpression once, exact derivatives beside the values.

The code is text, one operation a line, and is all that a compiled model is made from; its hash is the
model's identity in the cache and between processes. Nine functions:

``rhs``              f
``rhs_jacobian``     f and ∂f/∂y
``rhs_tangent``      f, ∂f/∂y and ∂f/∂q
``outputs``          g
``outputs_tangent``  g, ∂g/∂y and ∂g/∂q
``delays``           d
``delays_tangent``   d, ∂d/∂y and ∂d/∂q
``factorise``        LU factors of ``I - h·gamma·∂f/∂y``, see `elimination`
``solve``            a right-hand side replaced by the solution

∂/∂y is dense and written where it is not identically zero. ∂/∂q is sparse: one packed array, whose entries'
rows and columns are in `Source`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from rigctl.engine import elimination
from rigctl.engine.symbols import Expr, derivative
from rigctl.engine.system import System, after, before

#: arguments of each function: arrays, in order
ARGUMENTS: Mapping[str, tuple[str, ...]] = {
    "rhs": ("y", "u", "q", "value"),
    "rhs_jacobian": ("y", "u", "q", "value", "jacobian"),
    "rhs_tangent": ("y", "u", "q", "value", "jacobian", "packed"),
    "outputs": ("y", "u", "q", "value"),
    "outputs_tangent": ("y", "u", "q", "value", "jacobian", "packed"),
    "delays": ("y", "before", "after", "q", "value"),
    "delays_tangent": ("y", "before", "after", "q", "value", "jacobian", "packed"),
    **elimination.ARGUMENTS,
}

#: (row, parameter) of each entry of a packed ∂/∂q
Pattern = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Source:
    """The straight-line code of a system.

    Attributes
    ----------
    text: the functions.
    rhs_pattern, outputs_pattern, delays_pattern: (row, parameter) of each entry of the packed ∂/∂q.
    """

    text: str
    rhs_pattern: Pattern
    outputs_pattern: Pattern
    delays_pattern: Pattern

    @cached_property
    def digest(self) -> str:
        """Identifier of this model: equal exactly if the equations, their order and their constants are."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:32]


def source_of(system: System) -> Source:
    """The straight-line code of `system`."""
    indices = {
        **_places("y", system.state_names),
        **_places("u", system.input_names),
        **_places("q", system.parameter_names),
        **_places("before", [before(name) for name in system.input_names]),
        **_places("after", [after(name) for name in system.input_names]),
    }
    kinds = {
        "rhs": system.rhs,
        "outputs": tuple(output.expr for output in system.outputs),
        "delays": tuple(delay.expr for delay in system.delays),
    }
    # of each kind: values alone, with ∂/∂y for the steps, with ∂/∂q for the sensitivities. One function has
    # all of them, as derivatives share nearly all of their subexpressions with the values
    functions, patterns = [], []
    for kind, exprs in kinds.items():
        values = [("value", row, expr) for row, expr in enumerate(exprs)]
        jacobian = _jacobian(system, exprs)
        pattern, packed = _packed(system, exprs)
        functions.append(_function(kind, values, indices))
        if kind == "rhs":
            functions.append(_function("rhs_jacobian", values + jacobian, indices))
        functions.append(_function(f"{kind}_tangent", values + jacobian + packed, indices))
        patterns.append(pattern)
        if kind == "rhs":
            n = len(system.states)
            entries = [divmod(index, n) for _, index, _ in jacobian]
            solving = elimination.elimination(n, entries)
    functions.append(solving)
    return Source("".join(functions), *patterns)


Store = tuple[str, int, Expr]


def _places(array: str, names: Sequence[str]) -> dict[str, tuple[str, int]]:
    return {name: (array, index) for index, name in enumerate(names)}


def _variables(system: System, names: Sequence[str]) -> list[Expr | None]:
    """The variables with these names; None for a declared name that no equation uses."""
    return [system.graph.variables.get(name) for name in names]


def _jacobian(system: System, exprs: Sequence[Expr]) -> list[Store]:
    states = _variables(system, system.state_names)
    return [
        ("jacobian", row * len(states) + column, derivative(expr, state))
        for row, expr in enumerate(exprs)
        for column, state in enumerate(states)
        if state is not None and expr.depends_on & state.depends_on
    ]


def _packed(system: System, exprs: Sequence[Expr]) -> tuple[Pattern, list[Store]]:
    pattern: list[tuple[int, int]] = []
    stores: list[Store] = []
    for row, expr in enumerate(exprs):
        for column, parameter in enumerate(_variables(system, system.parameter_names)):
            if parameter is not None and expr.depends_on & parameter.depends_on:
                stores.append(("packed", len(pattern), derivative(expr, parameter)))
                pattern.append((row, column))
    return tuple(pattern), stores


def _function(name: str, stores: Sequence[Store], indices: Mapping[str, tuple[str, int]]) -> str:
    lines = [f"function {name} {' '.join(ARGUMENTS[name])}"]
    numbers: dict[int, int] = {}
    if stores:
        for number, node in enumerate(stores[0][2].graph.reachable([expr for _, _, expr in stores])):
            numbers[node.index] = number
            lines.append(f"{number} {_operation(node, numbers, indices)}")
    lines += [f"store {array} {index} {numbers[expr.index]}" for array, index, expr in stores]
    return "\n".join([*lines, "end\n"])


def _operation(node: Expr, numbers: Mapping[int, int], indices: Mapping[str, tuple[str, int]]) -> str:
    if node.op == "variable":
        array, index = indices[node.name]
        return f"load {array} {index}"
    if node.op == "constant":
        return f"constant {float(node.value)!r}"
    args = " ".join(str(numbers[arg.index]) for arg in node.args)
    if node.op == "power":
        exponent = node.value
        halves = isinstance(exponent, Fraction) and exponent.denominator <= 2
        return f"power {args} {exponent if halves else repr(float(exponent))}"
    return f"{node.op} {args}"
