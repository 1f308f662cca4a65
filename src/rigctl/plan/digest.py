"""A hash of what a plan does, for deciding whether two plans do the same."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from hashlib import sha256

from rigctl.errors import Location
from rigctl.expressions import Expression
from rigctl.plan.tree import Group

#: fields that are only shown, and do not change what is done
_NOT_DONE = frozenset(("label", "where", "bindings"))


def digest(*groups: Group) -> str:
    """Return the SHA-256, as hexadecimal digits, of all actions, conditions and paths of the groups.

    Line numbers, labels and comments are not included: moving a step within its file without changing the
    order, or showing a variable in another unit, leaves the hash unchanged.
    """
    state = sha256()
    for group in groups:
        for part in _parts(group):
            state.update(part.encode("utf-8"))
            state.update(b"\0")
    return state.hexdigest()


def _parts(value: object) -> Iterator[str]:
    if isinstance(value, Expression):
        yield value.text
    elif isinstance(value, Enum):
        yield str(value.value)
    elif is_dataclass(value) and not isinstance(value, Location):
        yield type(value).__name__
        for entry in fields(value):
            if entry.name not in _NOT_DONE:
                yield entry.name
                yield from _parts(getattr(value, entry.name))
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield str(key)
            yield from _parts(item)
    elif isinstance(value, tuple):
        yield f"{len(value)}"
        for item in value:
            yield from _parts(item)
    else:
        yield repr(value)
