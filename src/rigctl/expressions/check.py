"""Checks the dimensions of an expression, and whether each temperature is a point or a difference.

Temperatures are points on a scale or differences. A point minus a point is a difference, a point plus a
difference is a point, and two points cannot be added. A literal in kelvin may be either. A literal in degC
is a point, unless only a difference makes sense at its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal as TypingLiteral
from typing import TypeAlias

from rigctl.errors import RigctlError, unknown_name
from rigctl.expressions.functions import WITH_WIDTH
from rigctl.expressions.nodes import (
    Binary,
    Call,
    Comparison,
    Constant,
    Literal,
    Logic,
    Name,
    Negative,
    Node,
    Not,
    Variable,
)
from rigctl.expressions.types import BOOLEAN, NUMBER, TableType, ValueType

Kind: TypeAlias = TypingLiteral["point", "difference"] | None

_KELVIN_HINT = "Write a difference of temperatures in K"
_LARGEST_EXPONENT = 9


@dataclass(frozen=True, slots=True)
class Typed:
    """A node whose literals are SI constants, and its type.

    `written` is the original literal, as long as it can still be read as a difference.
    """

    node: Node
    type: ValueType
    written: Literal | None = None


def infer(node: Node, types: Mapping[str, ValueType]) -> Typed:  # noqa: PLR0911 - one for each kind
    """Check a tree and turn its literals into SI constants.

    Raises
    ------
    RigctlError
        a name is unknown, or dimensions are incompatible.
    """
    match node:
        case Literal() | Constant():
            return _literal(node)
        case Name(name):
            return Typed(node, _value_type(name, types))
        case Variable(name):
            return Typed(node, _look_up("variable", f"${name}", types))
        case Negative(operand):
            return _negative(infer(operand, types))
        case Binary(operator, left, right):
            return _binary(operator, infer(left, types), infer(right, types))
        case Call("table", arguments):
            return _table(arguments, types)
        case Call(function, arguments):
            return _call(function, [infer(argument, types) for argument in arguments])
        case Comparison(operands, operators):
            alike = _alike("compare", [infer(operand, types) for operand in operands])
            return Typed(Comparison(tuple(each.node for each in alike), operators), BOOLEAN)
        case Logic(operator, operands):
            conditions = tuple(_condition(operator, infer(operand, types)) for operand in operands)
            return Typed(Logic(operator, conditions), BOOLEAN)
        case Not(operand):
            return Typed(Not(_condition("not", infer(operand, types))), BOOLEAN)


def fit(typed: Typed, expected: ValueType) -> Typed:
    """Return the tree read as `expected`, which decides whether ``0.5 degC`` alone is a point or an interval.

    Raises
    ------
    RigctlError
        the tree has another type.
    """
    if expected.temperature == "difference":
        typed = _as_difference(typed)
    same = typed.type.boolean == expected.boolean and typed.type.dimension == expected.dimension
    if not same or _clash(typed.type, expected):
        raise RigctlError(f"this is {typed.type}", expected=expected.wanted)
    return typed


def _literal(node: Literal | Constant) -> Typed:
    if isinstance(node, Constant):
        return Typed(node, ValueType(node.dimension))
    unit = node.unit
    constant = Constant(unit.to_si(node.value), unit.dimension)
    if unit.absolute_temperature:
        return Typed(constant, ValueType(unit.dimension, "point"), node)
    return Typed(constant, ValueType(unit.dimension))


def _look_up(kind: str, name: str, types: Mapping[str, ValueType]) -> ValueType:
    if name not in types:
        dollars = name.startswith("$")
        raise unknown_name(kind, name, [known for known in types if known.startswith("$") == dollars])
    return types[name]


def _value_type(name: str, types: Mapping[str, ValueType]) -> ValueType:
    found = _look_up("name", name, types)
    if isinstance(found, TableType):
        raise RigctlError("a table is looked up", value=name, expected=f"table(x, {name})")
    return found


def _table(arguments: Sequence[Node], types: Mapping[str, ValueType]) -> Typed:
    """Check ``table(x, name)``: x must have the type of the table's argument."""
    known = [name for name, found in types.items() if isinstance(found, TableType)]
    written, curve = arguments
    if not isinstance(curve, Name):
        raise RigctlError(
            "table: the second is the name of a table", expected=", ".join(known) or "'tables:'"
        )
    found = types.get(curve.name)
    if not isinstance(found, TableType) or found.over is None:
        raise unknown_name("table", curve.name, known)
    x = _number(infer(written, types), "look up")
    if x.type.dimension != found.over.dimension:
        raise RigctlError(
            f"{curve.name} is looked up by {found.over}, not by {x.type}", expected=found.over.wanted
        )
    x = fit(x, found.over)
    return Typed(Call("table", (x.node, curve)), ValueType(found.dimension, found.temperature))


def _as_difference(typed: Typed) -> Typed:
    """Return a literal in degC read as a difference; anything else unchanged."""
    # "0.5 degC" is 273.65 K as a point and 0.5 K as a difference. Which of the two is meant shows only in its
    # surroundings, so the literal is kept in `written` until an operation decides.
    if typed.written is None:
        return typed
    literal = typed.written
    constant = Constant(literal.unit.to_si(literal.value, difference=True), literal.unit.dimension)
    return Typed(constant, ValueType(literal.unit.dimension, "difference"))


def _clash(a: ValueType, b: ValueType) -> bool:
    return a.temperature is not None and b.temperature is not None and a.temperature != b.temperature


def _number(typed: Typed, what: str) -> Typed:
    if typed.type.boolean:
        raise RigctlError(f"cannot {what} a condition", expected="a value")
    return typed


def _condition(operator: str, typed: Typed) -> Node:
    if not typed.type.boolean:
        raise RigctlError(f"'{operator}' joins conditions, and this is {typed.type}", expected="a comparison")
    return typed.node


def _alike(verb: str, operands: Sequence[Typed]) -> list[Typed]:
    """Return operands, which must have one type; literals in degC are read in the way the others require."""
    # Dimensions first: a message about points and differences would only confuse if the two are not even
    # temperatures.
    first = _number(operands[0], verb)
    for other in operands[1:]:
        _number(other, verb)
        if other.type.dimension != first.type.dimension:
            raise RigctlError(f"cannot {verb} {first.type} and {other.type}", expected=first.type.wanted)
    # One difference among them decides: every literal in degC is then a difference too, and a point (a
    # channel, say) that cannot be re-read is an error.
    if any(operand.type.temperature == "difference" for operand in operands):
        operands = [_as_difference(operand) for operand in operands]
        if any(operand.type.temperature == "point" for operand in operands):
            raise RigctlError(f"cannot {verb} a temperature and a temperature difference", hint=_KELVIN_HINT)
    return list(operands)


def _common(operands: Sequence[Typed]) -> ValueType:
    kinds = [operand.type.temperature for operand in operands if operand.type.temperature is not None]
    return ValueType(operands[0].type.dimension, kinds[0] if kinds else None)


def _negative(operand: Typed) -> Typed:
    _number(operand, "negate")
    operand = _as_difference(operand)
    if operand.type.temperature == "point":
        raise RigctlError("cannot negate a temperature", hint=_KELVIN_HINT)
    return Typed(Negative(operand.node), operand.type)


def _call(function: str, arguments: list[Typed]) -> Typed:
    if function in WITH_WIDTH:
        return _smooth(function, arguments)
    if function in ("min", "max"):
        arguments = _alike("compare", arguments)
        return Typed(Call(function, tuple(each.node for each in arguments)), _common(arguments))
    argument = _number(arguments[0], f"take {function} of")
    if function == "abs":
        argument = _as_difference(argument)
        result = argument.type
        if result.temperature == "point":
            raise RigctlError("cannot take abs of a temperature", hint=_KELVIN_HINT)
    elif function == "sqrt":
        _no_scale(argument)
        result = ValueType(argument.type.dimension ** Fraction(1, 2))
    else:
        result = NUMBER
        if not argument.type.dimension.dimensionless:
            raise RigctlError(f"cannot take {function} of {argument.type}", expected="a plain number")
    return Typed(Call(function, (argument.node,)), result)


def _smooth(function: str, arguments: list[Typed]) -> Typed:
    """Check a smoothed function: values of one type, then the width over which its corner is rounded."""
    *values, width = (_number(argument, f"take {function} of") for argument in arguments)
    if function == "spow" and not values[0].type.dimension.dimensionless:
        raise RigctlError(
            f"cannot take spow of {values[0].type}", expected="a plain number: divide by a reference first"
        )
    values, width = _alike("compare", values), _as_difference(width)
    if width.type.dimension != values[0].type.dimension:
        raise RigctlError(
            f"the width of {function} is {width.type}", expected=f"{values[0].type}, as what it rounds"
        )
    if width.type.temperature == "point":
        raise RigctlError(f"the width of {function} is a temperature", hint=_KELVIN_HINT)
    node = Call(function, tuple(each.node for each in (*values, width)))
    return Typed(node, NUMBER if function.startswith("smooth") else _common(values))


def _binary(operator: str, left: Typed, right: Typed) -> Typed:
    verb = {"+": "add", "-": "subtract", "*": "multiply", "/": "divide", "^": "raise to a power"}[operator]
    _number(left, verb)
    _number(right, verb)
    if operator in "+-":
        return _sum(operator, verb, left, right)
    if operator == "^":
        return _power(left, right)
    return _product(operator, verb, left, right)


def _sum(operator: str, verb: str, left: Typed, right: Typed) -> Typed:
    if left.type.dimension != right.type.dimension:
        raise RigctlError(f"cannot {verb} {left.type} and {right.type}", expected=left.type.wanted)
    if operator == "+":
        left, right = _addends(left, right)
        kind = _SUMS[left.type.temperature, right.type.temperature]
    else:
        if left.type.temperature == "difference":
            right = _as_difference(right)
        pair = (left.type.temperature, right.type.temperature)
        if pair == ("difference", "point"):
            raise RigctlError("cannot subtract a temperature from a difference", hint=_KELVIN_HINT)
        kind = _DIFFERENCES[pair]
    return Typed(Binary(operator, left.node, right.node), ValueType(left.type.dimension, kind))


def _addends(left: Typed, right: Typed) -> tuple[Typed, Typed]:
    """Return the terms of a sum; of two temperatures at most one may be a point, so a literal in degC becomes
    a difference."""
    if left.type.temperature == right.type.temperature == "point":
        if right.written:
            return left, _as_difference(right)
        if left.written:
            return _as_difference(left), right
        raise RigctlError("cannot add two temperatures", hint=_KELVIN_HINT)
    return left, right


#: kind of a sum of temperatures
_SUMS: Mapping[tuple[Kind, Kind], Kind] = {
    ("point", "difference"): "point",
    ("difference", "point"): "point",
    ("point", None): "point",
    (None, "point"): "point",
    ("difference", "difference"): "difference",
    ("difference", None): "difference",
    (None, "difference"): "difference",
    (None, None): None,
}

#: kind of a difference of temperatures; a point less a literal in kelvin may be either
_DIFFERENCES: Mapping[tuple[Kind, Kind], Kind] = {
    ("point", "point"): "difference",
    ("point", "difference"): "point",
    ("point", None): None,
    (None, "point"): "difference",
    ("difference", "difference"): "difference",
    ("difference", None): "difference",
    (None, "difference"): "difference",
    (None, None): None,
}


def _no_scale(typed: Typed) -> None:
    """Refuse a literal in degC in a product: its meaning is ambiguous."""
    if typed.written is not None:
        raise RigctlError(
            "a temperature in degC cannot be multiplied", value=str(typed.written), expected="one in K"
        )


def _product(operator: str, verb: str, left: Typed, right: Typed) -> Typed:
    _no_scale(left)
    _no_scale(right)
    node = Binary(operator, left.node, right.node)
    a, b = left.type.dimension, right.type.dimension
    result = ValueType(a * b if operator == "*" else a / b)
    if not result.is_temperature:
        return Typed(node, result)
    # A point has an arbitrary zero: 2·(20 degC) has no meaning, 2·(20 K) has.
    kinds = (left.type.temperature, right.type.temperature)
    if "point" in kinds:
        raise RigctlError(f"cannot {verb} a temperature by a number", hint=_KELVIN_HINT)
    return Typed(node, ValueType(result.dimension, "difference" if "difference" in kinds else None))


def _power(base: Typed, exponent: Typed) -> Typed:
    _no_scale(base)
    if not exponent.type.dimension.dimensionless:
        raise RigctlError(f"an exponent is a plain number, and this is {exponent.type}")
    node = Binary("^", base.node, exponent.node)
    if base.type.dimension.dimensionless:
        return Typed(node, NUMBER)
    # The dimension of x^n must be known before anything is evaluated, hence n as a written number.
    if not isinstance(exponent.node, Constant) or abs(exponent.node.value) > _LARGEST_EXPONENT:
        raise RigctlError(
            f"the exponent of {base.type} must be a number as written",
            expected=f"between -{_LARGEST_EXPONENT} and {_LARGEST_EXPONENT}",
        )
    dimension = base.type.dimension ** Fraction(exponent.node.value)
    return Typed(node, ValueType(dimension))
