"""A hash of a value's content: equal exactly if no computation can distinguish two values."""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np


class Opaque(TypeError):
    """A value whose content cannot be read, such as a function: results that depend on it cannot be kept."""


def digest(*values: object) -> str:
    """64 digits of the values' content.

    Numbers count with all their bits (0.0 is not -0.0, 1 is not 1.0), a NaN is a NaN, mappings count with
    their order, arrays with type and shape, dataclasses with their names and fields.

    Raises
    ------
    Opaque
        they contain something else.
    """
    into = hashlib.sha256()
    for value in values:
        _add(into, value)
    return into.hexdigest()


def _add(into: Any, value: object) -> None:
    # every piece starts with its kind and length, so that no two values produce the same bytes
    if value is None:
        into.update(b"-")
    elif isinstance(value, bool):
        into.update(b"T" if value else b"F")
    elif isinstance(value, np.generic):
        _add(into, value.item())
    elif isinstance(value, Enum):
        _text(into, b"e", f"{type(value).__qualname__}.{value.name}")
    elif isinstance(value, int):
        _text(into, b"i", str(value))
    elif isinstance(value, float):
        into.update(b"f" + struct.pack("<d", math.nan if math.isnan(value) else value))
    elif isinstance(value, str):
        _text(into, b"s", value)
    elif isinstance(value, np.ndarray):
        _array(into, value)
    elif isinstance(value, tuple | list):
        into.update(b"(" + struct.pack("<q", len(value)))
        for item in value:
            _add(into, item)
    elif isinstance(value, Mapping):
        into.update(b"{" + struct.pack("<q", len(value)))
        for key, item in value.items():
            _add(into, key)
            _add(into, item)
    elif isinstance(value, set | frozenset):
        _add(into, sorted(digest(item) for item in value))
    elif is_dataclass(value) and not isinstance(value, type):
        _text(into, b"d", type(value).__qualname__)
        for one in fields(value):
            _add(into, getattr(value, one.name))
    else:
        raise Opaque(f"{type(value).__qualname__} has no content that could be compared")


def _text(into: Any, kind: bytes, text: str) -> None:
    encoded = text.encode("utf-8", "surrogatepass")
    into.update(kind + struct.pack("<q", len(encoded)) + encoded)


def _array(into: Any, array: np.ndarray) -> None:
    if array.dtype.kind not in "fiub":
        raise Opaque(f"an array of {array.dtype} has no content that could be compared")
    _text(into, b"a", f"{array.dtype.str} {array.shape}")
    into.update(np.ascontiguousarray(array).data)
