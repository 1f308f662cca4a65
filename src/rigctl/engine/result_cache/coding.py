"""Values as plain data and back: a tree that can be stored as JSON, and arrays of numbers.

The requested type determines how data are read, never the content of a file: a file can contain numbers and
words, and nothing executable.
"""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

T = TypeVar("T")

#: the arrays that can be kept
DTYPES = ("<f8", "<i8", "|b1")


class Damaged(ValueError):
    """The data read are not of the requested type."""


def encode(value: object, arrays: list[np.ndarray]) -> Any:
    """The tree of `value`; its arrays are appended to `arrays`, in C order.

    Raises
    ------
    TypeError
        it contains something that cannot be kept.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Enum):
        return value.value
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        plain = np.array(value, dtype=value.dtype.newbyteorder("<"), order="C")
        if plain.dtype.str not in DTYPES:
            raise TypeError(f"an array of {value.dtype} cannot be kept")
        arrays.append(plain)
        return {"dtype": plain.dtype.str, "shape": list(plain.shape)}
    if is_dataclass(value) and not isinstance(value, type):
        return [encode(getattr(value, one.name), arrays) for one in fields(value)]
    if isinstance(value, tuple | list):
        return [encode(item, arrays) for item in value]
    if isinstance(value, Mapping):
        return [[encode(key, arrays), encode(item, arrays)] for key, item in value.items()]
    raise TypeError(f"{type(value).__qualname__} cannot be kept")


def decode(kind: type[T], tree: Any, arrays: Iterator[np.ndarray]) -> T:
    """The value of type `kind` contained in a tree and its arrays.

    Raises
    ------
    Damaged
        they contain something else.
    """
    try:
        return cast("T", _decode(kind, tree, arrays))
    except (TypeError, ValueError, KeyError, StopIteration) as problem:
        raise Damaged(str(problem)) from problem


def _decode(kind: Any, tree: Any, arrays: Iterator[np.ndarray]) -> Any:
    origin, inside = get_origin(kind), get_args(kind)
    alias = getattr(origin, "__value__", None)  # numpy 2.5 declares NDArray by a 'type' statement
    if alias is not None:
        origin = get_origin(alias) or alias
    if origin in (Union, types.UnionType):
        if tree is None and type(None) in inside:
            return None
        (kind,) = (one for one in inside if one is not type(None))
        return _decode(kind, tree, arrays)
    if origin is Literal:
        return _require(tree, tree in inside)
    if origin is np.ndarray or kind is np.ndarray:
        return _array(tree, arrays)
    if is_dataclass(kind):
        hints = _hints(cast("Any", kind))
        _require(tree, isinstance(tree, list) and len(tree) == len(hints))
        built = [_decode(hint, item, arrays) for hint, item in zip(hints.values(), tree, strict=True)]
        return cast("Any", kind)(**dict(zip(hints, built, strict=True)))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(tree)
    if origin is not None:
        return _collection(origin, inside, tree, arrays)
    if kind is float:
        return float(_require(tree, isinstance(tree, float | int) and not isinstance(tree, bool)))
    return _require(tree, type(tree) is kind and kind in (bool, int, str))


def _collection(origin: Any, inside: Sequence[Any], tree: Any, arrays: Iterator[np.ndarray]) -> Any:
    _require(tree, isinstance(tree, list))
    if issubclass(origin, Mapping):
        key, item = inside
        return {_decode(key, k, arrays): _decode(item, v, arrays) for k, v in tree}
    if origin is tuple and not (len(inside) == 2 and inside[1] is Ellipsis):
        return tuple(_decode(one, item, arrays) for one, item in zip(inside, tree, strict=True))
    _require(tree, origin in (tuple, list))
    return origin(_decode(inside[0], item, arrays) for item in tree)


def _array(tree: Any, arrays: Iterator[np.ndarray]) -> np.ndarray:
    array = next(arrays)
    _require(tree, tree == {"dtype": array.dtype.str, "shape": list(array.shape)})
    return array


def _require(tree: Any, right: bool) -> Any:
    if not right:
        raise Damaged(f"unexpected {type(tree).__name__}")
    return tree


@cache
def _hints(kind: Any) -> dict[str, Any]:
    """The fields of a dataclass with their types."""
    hints = get_type_hints(kind)
    return {one.name: hints[one.name] for one in fields(kind)}
