"""The nodes of an expression's syntax tree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

from rigctl.units import DIMENSIONLESS, Dimension, Unit


@dataclass(frozen=True, slots=True)
class Literal:
    """A number as written, with its unit; whether one in degC is a point or a difference is not known yet."""

    value: float
    unit: Unit

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit.text}".strip()


@dataclass(frozen=True, slots=True)
class Constant:
    """A number in SI, with its dimension."""

    value: float
    dimension: Dimension = DIMENSIONLESS


@dataclass(frozen=True, slots=True)
class Name:
    """A channel, a command or a measure."""

    name: str


@dataclass(frozen=True, slots=True)
class Variable:
    """``$name``: a sweep's variable or an argument."""

    name: str


@dataclass(frozen=True, slots=True)
class Negative:
    """``-a``"""

    operand: Node


@dataclass(frozen=True, slots=True)
class Binary:
    """``a + b``, ``a - b``, ``a * b``, ``a / b`` or ``a ^ b``."""

    operator: str
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class Call:
    """``abs(a)``, ``min(a, b)`` …"""

    function: str
    arguments: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Comparison:
    """``a < b <= c``: true when every neighbouring pair is in order."""

    operands: tuple[Node, ...]
    operators: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Logic:
    """``a and b and c`` or ``a or b or c``."""

    operator: str
    operands: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Not:
    """``not a``"""

    operand: Node


Node: TypeAlias = Literal | Constant | Name | Variable | Negative | Binary | Call | Comparison | Logic | Not


def children(node: Node) -> tuple[Node, ...]:
    """Return the nodes directly below."""
    match node:
        case Negative(operand) | Not(operand):
            return (operand,)
        case Binary(_, left, right):
            return (left, right)
        case Call(_, arguments):
            return arguments
        case Comparison(operands, _) | Logic(_, operands):
            return operands
        case _:
            return ()


def walk(node: Node) -> Iterator[Node]:
    """Yield the node and all nodes below it."""
    yield node
    for child in children(node):
        yield from walk(child)


def replace_leaves(node: Node, leaf: Callable[[Node], Node]) -> Node:  # noqa: PLR0911 - one for each kind
    """Return a copy of the tree with every number, name and variable replaced by the result of `leaf`."""
    match node:
        case Negative(operand):
            return Negative(replace_leaves(operand, leaf))
        case Not(operand):
            return Not(replace_leaves(operand, leaf))
        case Binary(operator, left, right):
            return Binary(operator, replace_leaves(left, leaf), replace_leaves(right, leaf))
        case Call(function, arguments):
            return Call(function, tuple(replace_leaves(argument, leaf) for argument in arguments))
        case Comparison(operands, operators):
            return Comparison(tuple(replace_leaves(operand, leaf) for operand in operands), operators)
        case Logic(operator, operands):
            return Logic(operator, tuple(replace_leaves(operand, leaf) for operand in operands))
        case _:
            return leaf(node)
