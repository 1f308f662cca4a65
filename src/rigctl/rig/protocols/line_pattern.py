"""Patterns of commands and answers of line-based devices: texts with placeholders in braces.

``Q1 {value:.1f}`` is sent with a number in place of the braces. ``{_},{pressure},{position}`` reads two
numbers from an answer and ignores the text before them. Matching searches for each literal once, from
left to right: its time is proportional to the length of the line, whatever a device sends.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import BeforeValidator, Field, WithJsonSchema

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal

ANYTHING = "_"  #: placeholder for text that is ignored
VALUE = "value"  #: placeholder for the value of an actuator
_PLACE = re.compile(r"\{\{|\}\}|\{([^{}]*)\}|[{}]")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}|_")
_FORMAT = re.compile(r"(?:\.\d)?[feg]|d")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?")


@dataclass(frozen=True)
class ReplyPattern:
    """One line of an answer: literal, placeholder, literal, …, with a possibly empty literal at both ends."""

    literals: tuple[str, ...]
    places: tuple[str, ...]

    def match(self, line: str) -> Mapping[str, str] | None:
        """Return the texts at the placeholders, by name; None if the line does not match.

        Blanks at both ends of the line are ignored.
        """
        line = line.strip()
        first, *others = self.literals
        if not line.startswith(first):
            return None
        position, found = len(first), dict[str, str]()
        for index, (name, literal) in enumerate(zip(self.places, others, strict=True)):
            if index == len(self.places) - 1:  # the last placeholder takes the rest
                end = len(line) - len(literal)
                if end < position or not line.endswith(literal):
                    return None
            else:
                end = line.find(literal, position)
                if end < 0:
                    return None
            if name != ANYTHING:
                found[name] = line[position:end].strip()
            position = end + len(literal)
        return found if position == len(line) else None


@dataclass(frozen=True)
class SendTemplate:
    """A command with at most one placeholder, for the value."""

    before: str
    after: str = ""
    form: str | None = None  #: format of the number; None without a placeholder

    def fill(self, value: float | str) -> str:
        """Return the command with a number or word in place of its placeholder."""
        return self.before if self.form is None else f"{self.before}{self.written(value)}{self.after}"

    def written(self, value: float | str) -> str:
        """Return a number or word as it is sent."""
        if isinstance(value, str):
            return value
        return str(round(value)) if self.form == "d" else format(value, self.form or "g")


def read_number(text: str) -> float | None:
    """Return the number in a device's answer, which may be NaN; None for any other text."""
    if _NUMBER.fullmatch(text):
        return float(text)
    return math.nan if text.casefold() == "nan" else None


def resolution(text: str) -> float:
    """Return the place value of the last digit of a number given as text."""
    mantissa, _, exponent = text.casefold().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return float(10.0 ** (int(exponent or 0) - decimals))


def is_whole(text: str) -> bool:
    """Return whether a number given as text has neither decimals nor an exponent."""
    return text.strip().lstrip("+-").isdecimal()


def says(answer: str, expected: str) -> bool:
    """Return whether an answer repeats a word or, as exactly as both are written, a number."""
    if answer.casefold() == expected.casefold():
        return True
    said, meant = read_number(answer), read_number(expected)
    if said is None or meant is None:
        return False
    if is_whole(expected):  # '1' and '1.0' are no rounded '0', which may be the other position of a switch
        return abs(said - meant) < max(resolution(answer), 1.0)
    return abs(said - meant) <= resolution(answer) + resolution(expected)


def reply_pattern(text: str) -> ReplyPattern:
    """Return the pattern that a text describes.

    Raises
    ------
    RigctlError
        a brace is not closed, a placeholder has no valid name or is repeated, or two are adjacent.
    """
    literals, places = _split(text)
    for place in places:
        if not _NAME.fullmatch(place):
            raise RigctlError("no name in braces", value=f"{{{place}}}", expected="e.g. {temperature} or {_}")
        if place != ANYTHING and places.count(place) > 1:
            raise RigctlError("this place comes twice", value=f"{{{place}}}")
    if any(not literal for literal in literals[1:-1]):
        raise RigctlError("two places touch", value=text, expected="something between them, e.g. {a},{b}")
    return ReplyPattern(literals, places)


def send_template(text: str) -> SendTemplate:
    """Return the command that a text describes.

    Raises
    ------
    RigctlError
        the text is empty, or has more than one line, a placeholder other than ``{value}``, or several
        placeholders.
    """
    if not text.strip() or "\n" in text or "\r" in text:
        raise RigctlError("a command is one line", value=repr(text), expected="e.g. 'Q1 {value:.1f}'")
    literals, places = _split(text)
    if not places:
        return SendTemplate(literals[0])
    name, _, form = places[0].partition(":")
    if len(places) > 1 or name != VALUE or (form and not _FORMAT.fullmatch(form)):
        raise RigctlError(
            "not a place that can be filled",
            value="".join(f"{{{place}}}" for place in places),
            expected="one {value}, or with a format: {value:.1f}, {value:d}",
        )
    return SendTemplate(literals[0], literals[1], form or "g")


def _split(text: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the literals and the placeholders; a doubled brace is a literal brace."""
    literals, places, position = [""], list[str](), 0
    for found in _PLACE.finditer(text):
        literals[-1] += text[position : found.start()]
        position = found.end()
        if found[0] in ("{{", "}}"):
            literals[-1] += found[0][0]
        elif found[1] is None:
            raise RigctlError("a lone brace", value=text, expected="{name}, or {{ for a brace itself")
        else:
            places.append(found[1])
            literals.append("")
    literals[-1] += text[position:]
    return tuple(literals), tuple(places)


def _checked_reply(written: object) -> str:
    return _checked(written, reply_pattern)


def _checked_send(written: object) -> str:
    return _checked(written, send_template)


def _checked(written: object, read: Callable[[str], object]) -> str:
    if not isinstance(written, str):
        raise refusal(RigctlError("wrong kind of value", value=str(written), expected="text, in quotes"))
    try:
        read(written)
    except RigctlError as error:
        raise refusal(error) from error
    return written


def _as_lines(written: object) -> object:
    return (written,) if isinstance(written, str) else written


#: a command of a rig file
SendText = Annotated[str, BeforeValidator(_checked_send)]
#: one line of an answer, as a rig file describes it
ReplyText = Annotated[str, BeforeValidator(_checked_reply)]
#: an answer of one line, or of several
ReplyLines = Annotated[
    tuple[ReplyText, ...],
    BeforeValidator(_as_lines),
    Field(max_length=64),
    WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}),
]
