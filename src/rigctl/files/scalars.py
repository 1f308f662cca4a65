"""Plain scalars of YAML 1.2 (core schema, section 10.3.2 of the specification)."""

from __future__ import annotations

import json
import re

Scalar = str | int | float | bool | None

_NULL = frozenset(("", "~", "null", "Null", "NULL"))
_TRUE = frozenset(("true", "True", "TRUE"))
_FALSE = frozenset(("false", "False", "FALSE"))
# of limited length, so that no number in a file takes long to convert
_INTEGER = re.compile(r"[-+]?[0-9]{1,300}")
_OCTAL = re.compile(r"0o[0-7]{1,300}")
_HEXADECIMAL = re.compile(r"0x[0-9a-fA-F]{1,300}")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]{1,300}|[0-9]{1,300}(?:\.[0-9]{0,300})?)(?:[eE][-+]?[0-9]{1,9})?")
_INFINITY = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NOT_A_NUMBER = frozenset((".nan", ".NaN", ".NAN"))


def read_plain(text: str) -> Scalar:
    """Return the value of an unquoted scalar; anything but a number, boolean or null is text.

    ``yes``, ``on`` and ``12:30`` are text, according to YAML 1.2.
    """
    if text in _NULL:
        return None
    if text in _TRUE:
        return True
    if text in _FALSE:
        return False
    return _read_number(text)


def _read_number(text: str) -> str | int | float:
    value: str | int | float = text
    if _INTEGER.fullmatch(text):
        value = int(text)
    elif _OCTAL.fullmatch(text) or _HEXADECIMAL.fullmatch(text):
        value = int(text, 0)
    elif _FLOAT.fullmatch(text):
        value = float(text)
    elif infinity := _INFINITY.fullmatch(text):
        value = float(f"{infinity.group(1)}inf")
    elif text in _NOT_A_NUMBER:
        value = float("nan")
    return value


def quoted(text: object) -> str:
    """A text as YAML reads it back: in double quotes, which are JSON's."""
    return json.dumps(str(text), ensure_ascii=False)
