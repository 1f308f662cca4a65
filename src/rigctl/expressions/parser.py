"""Parses tokens into a tree, by recursive descent with a bounded depth.

either      = both { "or" both }
both        = inverse { "and" inverse }
inverse     = "not" inverse | comparison
comparison  = sum { ("<" | "<=" | ">" | ">=" | "==" | "!=") sum }
sum         = product { ("+" | "-") product }
product     = signed { ("*" | "/") signed }
signed      = ("-" | "+") signed | power
power       = atom [ "^" signed ]
atom        = number [unit] | name | "$" name | function "(" either { "," either } ")" | "(" either ")"
"""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.errors import Location, RigctlError, unknown_name
from rigctl.expressions.functions import Function
from rigctl.expressions.nodes import (
    Binary,
    Call,
    Comparison,
    Literal,
    Logic,
    Name,
    Negative,
    Node,
    Not,
    Variable,
)
from rigctl.expressions.tokens import Token, tokenise

MAX_DEPTH = 30

_COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")


def parse_tree(text: str, where: Location, functions: Mapping[str, Function]) -> Node:
    """Return the tree of an expression that may call `functions`.

    Raises
    ------
    RigctlError
        the text is not an expression of the grammar.
    """
    return _Parser(text, tokenise(text, where), where, functions).whole()


class _Parser:
    def __init__(
        self, text: str, tokens: list[Token], where: Location, functions: Mapping[str, Function]
    ) -> None:
        self.functions = functions
        self.text = text
        self.tokens = tokens
        self.where = where
        self.index = 0
        self.depth = 0

    def whole(self) -> Node:
        node = self.either()
        if self.token.kind != "end":
            raise self.unexpected("an operator")
        return node

    @property
    def token(self) -> Token:
        return self.tokens[self.index]

    def take(self, *texts: str) -> str | None:
        """Consume the next token and return its text, if it is one of these operators or words."""
        token = self.token
        if token.kind in ("operator", "word") and token.text in texts:
            self.index += 1
            return token.text
        return None

    def unexpected(self, expected: str) -> RigctlError:
        token = self.token
        before = self.text[: token.start].strip()
        behind = f" after '{before[-20:]}'" if before else ""
        what = f"the expression ends{behind}" if token.kind == "end" else f"not expected here{behind}"
        value = None if token.kind == "end" else self.text[token.start :].split(" ")[0]
        return RigctlError(what, value=value, expected=expected, where=self.where)

    def deeper(self) -> None:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise RigctlError(
                "the expression is nested too deep", expected=f"at most {MAX_DEPTH} levels", where=self.where
            )

    def either(self) -> Node:
        return self.logic("or")

    def logic(self, word: str) -> Node:
        operands = [self.logic("and") if word == "or" else self.inverse()]
        while self.take(word):
            operands.append(self.logic("and") if word == "or" else self.inverse())
        return operands[0] if len(operands) == 1 else Logic(word, tuple(operands))

    def inverse(self) -> Node:
        if self.take("not"):
            self.deeper()
            node: Node = Not(self.inverse())
            self.depth -= 1
            return node
        return self.comparison()

    def comparison(self) -> Node:
        operands, operators = [self.sum()], []
        while operator := self.take(*_COMPARISONS):
            operators.append(operator)
            operands.append(self.sum())
        return Comparison(tuple(operands), tuple(operators)) if operators else operands[0]

    def sum(self) -> Node:
        node = self.product()
        while operator := self.take("+", "-"):
            node = Binary(operator, node, self.product())
        return node

    def product(self) -> Node:
        node = self.signed()
        while operator := self.take("*", "/"):
            node = Binary(operator, node, self.signed())
        return node

    def signed(self) -> Node:
        sign = self.take("-", "+")
        if sign is None:
            return self.power()
        self.deeper()
        operand = self.signed()
        self.depth -= 1
        if sign == "+":
            return operand
        # '-5 degC' is a negative number, whereas '-2^2' is not the square of one
        if isinstance(operand, Literal):
            return Literal(-operand.value, operand.unit)
        return Negative(operand)

    def power(self) -> Node:
        base = self.atom()
        if not self.take("^"):
            return base
        self.deeper()
        exponent = self.signed()
        self.depth -= 1
        return Binary("^", base, exponent)

    def atom(self) -> Node:
        token = self.token
        if token.kind == "number" and token.unit is not None:
            self.index += 1
            return Literal(token.value, token.unit)
        if token.kind == "variable":
            self.index += 1
            return Variable(token.text)
        if token.kind == "name":
            self.index += 1
            return self.call(token.text) if self.take("(") else Name(token.text)
        if self.take("("):
            self.deeper()
            node = self.either()
            self.depth -= 1
            if not self.take(")"):
                raise self.unexpected("')'")
            return node
        raise self.unexpected("a number with its unit, a name or '('")

    def call(self, name: str) -> Node:
        function = self.functions.get(name)
        if function is None:
            raise unknown_name("function", name, self.functions, where=self.where)
        self.deeper()
        arguments = [self.either()]
        while self.take(","):
            arguments.append(self.either())
        self.depth -= 1
        if not self.take(")"):
            raise self.unexpected("')'")
        if not function.takes(len(arguments)):
            raise RigctlError(
                f"{name} takes {function.wants}",
                value=f"{len(arguments)}",
                where=self.where,
                expected=f"{name}(…)",
            )
        return Call(name, tuple(arguments))
