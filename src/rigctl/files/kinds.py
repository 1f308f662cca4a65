"""The kinds of files that users write, which are distinguished by their keys."""

from __future__ import annotations

from collections.abc import Collection, Mapping

#: the key that identifies a kind of file; in this order, since a rig file also has `model`
_KEYS: Mapping[str, str] = {
    "effect": "effect",  # before "family", since an effect file also names its family
    "family": "family",
    "procedure": "procedure",
    "steps": "procedure",
    "channels": "rig",
    "actuators": "rig",
    "model": "model",
}


def kind_of_keys(keys: Collection[object]) -> str | None:
    """Return the kind of a file with these keys: procedure, rig, model, family or effect; None if unknown."""
    return next((kind for key, kind in _KEYS.items() if key in keys), None)


def file_of(kind: str) -> str:
    """Return the kind with its article: ``a rig file``, ``an effect file``."""
    return f"{'an' if kind == 'effect' else 'a'} {kind} file"


def other_kind(keys: Collection[str], fields: Collection[str]) -> tuple[str, str] | None:
    """Return the kind of a file with these keys, and the expected kind, with the `fields`, if they differ.

    None also for a file that is almost of the expected kind: it has the key that identifies that kind, and at
    most one key that does not belong to it.
    """
    found, expected = kind_of_keys(keys), kind_of_keys(fields)
    if found is None or expected is None or found == expected:
        return None
    identified = any(_KEYS.get(key) == expected for key in keys)
    if identified and len(set(keys) - set(fields)) < 2:
        return None
    if found == "model" and "name" in keys:  # a rig file without channels: no other kind has a name
        return None
    return found, expected
