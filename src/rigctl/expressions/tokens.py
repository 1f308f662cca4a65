"""Splits a text into tokens; a number includes the unit that follows it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from rigctl.errors import Location, RigctlError
from rigctl.units import Unit, parse_unit

MAX_LENGTH = 1000
MAX_TOKENS = 250

WORDS = frozenset(("and", "or", "not"))

_SPACE = re.compile(r"\s+")
_NUMBER = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_NAME = re.compile(r"[^\W\d]\w*")
_VARIABLE = re.compile(r"\$([^\W\d]\w*)")
_OPERATOR = re.compile(r"<=|>=|==|!=|[-+*/^()<>,]")
# without blanks, so that '1 bar / position' is a division and '1 l/min' is not
_UNIT_NAME = r"(?:[^\W\d]\w*|°[CF]|%)"
_UNIT = re.compile(rf"\s*({_UNIT_NAME}(?:\^-?\d)?(?:[*/]{_UNIT_NAME}(?:\^-?\d)?)*)")
_LAST_FACTOR = re.compile(rf"(?:\^-?\d|[*/]{_UNIT_NAME})$")

#: operators of other languages, each with its equivalent in this grammar
_INSTEAD = {
    "=": "==",
    "&&": "and",
    "&": "and",
    "||": "or",
    "|": "or",
    "!": "not",
    "**": "^",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
}
_FOREIGN = re.compile(r"=(?!=)|&&?|\|\|?|!(?!=)|\*\*|[≤≥≠]")


@dataclass(frozen=True, slots=True)
class Token:
    """A token: `kind` is number, name, variable, operator, word or end."""

    kind: str
    text: str
    start: int
    value: float = 0.0
    unit: Unit | None = None


def tokenise(text: str, where: Location) -> list[Token]:
    """Return the tokens of an expression, followed by an ``end`` token.

    Raises
    ------
    RigctlError
        the text is too long, has a character that is not allowed in an expression, or an unknown unit.
    """
    if len(text) > MAX_LENGTH:
        raise RigctlError(
            "the expression is too long", expected=f"at most {MAX_LENGTH} characters", where=where
        )
    tokens: list[Token] = []
    position = 0
    while position < len(text):
        if space := _SPACE.match(text, position):
            position = space.end()
            continue
        token, position = _next(text, position, where)
        tokens.append(token)
        if len(tokens) > MAX_TOKENS:
            raise RigctlError(
                "the expression is too long", expected=f"at most {MAX_TOKENS} parts", where=where
            )
    return [*tokens, Token("end", "", len(text))]


def _too_long(most: str, where: Location) -> RigctlError:
    return RigctlError("the expression is too long", expected=f"at most {most}", where=where)


def _next(text: str, position: int, where: Location) -> tuple[Token, int]:
    if number := _NUMBER.match(text, position):
        return _number(text, number, where)
    if variable := _VARIABLE.match(text, position):
        return Token("variable", variable.group(1), position), variable.end()
    if name := _NAME.match(text, position):
        kind = "word" if name.group() in WORDS else "name"
        return Token(kind, name.group(), position), name.end()
    if foreign := _FOREIGN.match(text, position):
        raise RigctlError(
            "no operator of this grammar",
            value=foreign.group(),
            expected=f"'{_INSTEAD[foreign.group()]}'",
            where=where,
        )
    if operator := _OPERATOR.match(text, position):
        return Token("operator", operator.group(), position), operator.end()
    raise RigctlError(
        "this has no place in an expression",
        value=text[position],
        expected="numbers with units, names, $variables, + - * / ^, comparisons, and, or, not",
        where=where,
    )


def _number(text: str, match: re.Match[str], where: Location) -> tuple[Token, int]:
    value = float(match.group())
    if not math.isfinite(value):
        raise RigctlError("not a finite number", value=match.group(), where=where)
    behind = _UNIT.match(text, match.end())
    if behind is None or behind.group(1) in WORDS:
        return Token("number", match.group(), match.start(), value, parse_unit("")), match.end()
    unit, end = _longest_unit(behind.group(1), behind.end(), where)
    return Token("number", text[match.start() : end], match.start(), value, unit), end


def _longest_unit(text: str, end: int, where: Location) -> tuple[Unit, int]:
    """Return the longest prefix of `text` that is a unit, so that ``2 bar/position`` divides by a channel."""
    shorter = text
    while True:
        try:
            return parse_unit(shorter), end - (len(text) - len(shorter))
        except RigctlError as error:
            cut = _LAST_FACTOR.search(shorter)
            if cut is None:
                raise error.at(where) from None
            shorter = shorter[: cut.start()]
