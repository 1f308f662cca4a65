"""The fields of a model at a location in a document, for suggesting the correct name for a misspelt one."""

from __future__ import annotations

import types
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel
from typing_extensions import TypeAliasType

from rigctl.files.nodes import Key


def field_names(models: Iterable[Any]) -> set[str]:
    """Return the names under which the fields of `models` are written."""
    return {
        info.alias or name
        for model in models
        if isinstance(model, type) and issubclass(model, BaseModel)
        for name, info in model.model_fields.items()
    }


def types_at(model: Any, keys: Sequence[Key]) -> list[Any]:
    """Return the types that a value under `keys` may have, with unions and containers expanded.

    A key that is a field of none of them is pydantic's name for a branch of a union, and selects that branch.
    """
    current = _branches(model)
    for key in keys:
        below = [inner for kind in current for inner in _below(kind, key)]
        current = below or [kind for kind in current if _is_branch(kind, str(key))] or current
    return current


def _branches(kind: Any) -> list[Any]:
    """Return a type without its annotations; for a union, its members."""
    if isinstance(kind, TypeAliasType):
        return _branches(kind.__value__)
    if get_origin(kind) is Annotated:
        return _branches(get_args(kind)[0])
    if get_origin(kind) in (Union, types.UnionType):
        return [inner for member in get_args(kind) for inner in _branches(member)]
    return [kind]


def _below(kind: Any, key: Key) -> list[Any]:
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        for name, info in kind.model_fields.items():
            if key in (name, info.alias):
                return _branches(info.annotation)
        return []
    arguments = [argument for argument in get_args(kind) if argument is not Ellipsis]
    if not arguments:
        return []
    if isinstance(key, str) and len(arguments) == 2:  # a mapping
        return _branches(arguments[1])
    if isinstance(key, int):
        return _branches(arguments[min(key, len(arguments) - 1)])
    return []


def _is_branch(kind: Any, name: str) -> bool:
    return getattr(kind, "__name__", None) == name or any(
        name in get_args(info.annotation) for info in getattr(kind, "model_fields", {}).values()
    )
