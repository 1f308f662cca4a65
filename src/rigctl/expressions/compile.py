"""Compiles a checked tree to nested closures over a row of values, fast enough for every sample.

In: a tree from `rigctl.expressions.check`, whose literals are SI constants, and the names of the row's
columns. Out: a function of a row. Names become indices and operators become functions here, once; no code of
the user is executed, and nothing is parsed or looked up by name during a record. `position < 1 mm` becomes
one comparison of a row's entry with a number.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from rigctl.errors import unknown_name
from rigctl.expressions.functions import ALL_FUNCTIONS, divide, power
from rigctl.expressions.nodes import (
    Binary,
    Call,
    Comparison,
    Constant,
    Logic,
    Name,
    Negative,
    Node,
    Not,
    Variable,
)

Row: TypeAlias = Sequence[float]
Number: TypeAlias = Callable[[Row], float]
Condition: TypeAlias = Callable[[Row], bool]

_ARITHMETIC: Mapping[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": divide,
    "^": power,
}
_ORDER: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


def compile_tree(node: Node, row: Sequence[str]) -> Callable[[Row], float | bool]:
    """Return a function from a row of SI values, with columns named `row`, to the value of a checked tree.

    Raises
    ------
    RigctlError
        a name is not a column of the row.
    """
    index = {name: place for place, name in enumerate(row)}
    if isinstance(node, Comparison | Logic | Not):
        return compile_condition(node, index)
    return compile_number(node, index)


def compile_number(node: Node, index: Mapping[str, int]) -> Number:
    """Return a function from a row to the value of a checked, numeric tree.

    `index` gives the index in the row of each name, and of each variable with its dollar.
    """
    match node:
        case Constant(value):
            return lambda row: value
        case Name() | Variable():
            return operator.itemgetter(place_of(node, index))
        case Negative(operand):
            inner = compile_number(operand, index)
            return lambda row: -inner(row)
        case Binary():
            return _binary(node, index)
        case Call(function, arguments):
            return _call(function, [compile_number(argument, index) for argument in arguments])
        case _:
            raise TypeError(f"not a checked number: {node}")


def compile_condition(node: Node, index: Mapping[str, int]) -> Condition:
    """Return a function from a row to the truth value of a checked condition."""
    match node:
        case Comparison(operands, operators) if len(operators) == 1:
            return _comparison(operands[0], operators[0], operands[1], index)
        case Comparison(operands, operators):
            pairs = zip(operands, operators, operands[1:], strict=False)
            return _all([_comparison(left, order, right, index) for left, order, right in pairs])
        case Logic(word, operands):
            conditions = [compile_condition(operand, index) for operand in operands]
            return _all(conditions) if word == "and" else _any(conditions)
        case Not(operand):
            inner = compile_condition(operand, index)
            return lambda row: not inner(row)
        case _:
            raise TypeError(f"not a checked condition: {node}")


def place_of(node: Name | Variable, index: Mapping[str, int]) -> int:
    """Return the index of a name or a variable in the row."""
    name = node.name if isinstance(node, Name) else f"${node.name}"
    if name not in index:
        raise unknown_name("name", name, index)
    return index[name]


def _binary(node: Binary, index: Mapping[str, int]) -> Number:
    compute = _ARITHMETIC[node.operator]
    left, right = compile_number(node.left, index), compile_number(node.right, index)
    # A constant operand is bound here, once, instead of being called for in every sample; likewise the
    # comparison of one channel with a number below. Conditions run at every sample of a record.
    if isinstance(node.right, Constant):
        value = node.right.value
        return lambda row: compute(left(row), value)
    return lambda row: compute(left(row), right(row))


def _call(function: str, arguments: list[Number]) -> Number:
    compute = ALL_FUNCTIONS[function].compute
    if len(arguments) == 1:
        only = arguments[0]
        return lambda row: compute(only(row))
    return lambda row: compute(*[argument(row) for argument in arguments])


def _comparison(left: Node, order: str, right: Node, index: Mapping[str, int]) -> Condition:
    compare = _ORDER[order]
    if isinstance(left, Name | Variable) and isinstance(right, Constant):
        return _threshold(order, place_of(left, index), right.value)
    first, second = compile_number(left, index), compile_number(right, index)
    # every comparison with a missing value is false
    if order == "!=":
        return lambda row: _differ(first(row), second(row))
    return lambda row: compare(first(row), second(row))


def _threshold(order: str, place: int, value: float) -> Condition:
    """Compare a channel with a number, the most common condition, without a further function call."""
    match order:
        case "<":
            return lambda row: row[place] < value
        case "<=":
            return lambda row: row[place] <= value
        case ">":
            return lambda row: row[place] > value
        case ">=":
            return lambda row: row[place] >= value
        case "==":
            return lambda row: row[place] == value
        case _:
            return lambda row: _differ(row[place], value)


def _differ(a: float, b: float) -> bool:
    return a != b and not math.isnan(a) and not math.isnan(b)


def _all(conditions: list[Condition]) -> Condition:
    if len(conditions) == 2:
        first, second = conditions
        return lambda row: first(row) and second(row)
    return lambda row: all(condition(row) for condition in conditions)


def _any(conditions: list[Condition]) -> Condition:
    if len(conditions) == 2:
        first, second = conditions
        return lambda row: first(row) or second(row)
    return lambda row: any(condition(row) for condition in conditions)
