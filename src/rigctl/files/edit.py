"""Changes the entries of one mapping in a YAML file; refuses if that would change anything else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.errors import Location, RigctlError
from rigctl.files.layout import Text


def set_entries(text: str, keys: Sequence[str], entries: Mapping[str, str]) -> str:
    """Return the text with `entries` in the mapping under `keys`, which is added if it is missing.

    Parameters
    ----------
    text: a YAML document whose root is a mapping.
    keys: path from the root to the mapping; all keys but the last must exist.
    entries: values by name, each as one line of YAML.

    Raises
    ------
    RigctlError
        a part of the path is missing, is not a mapping, or is an alias of another part of the file; or a
        value that would be replaced contains a comment or has an anchor.
    """
    _check_path(text, keys, entries)
    changed = Text(text)
    for name, value in entries.items():
        if changed.has(*keys, name):
            changed.replace((*keys, name), value)
        else:
            changed.insert((*keys, name), value)
    return changed.text


def _check_path(text: str, keys: Sequence[str], entries: Mapping[str, str]) -> None:
    """Check that every part of the path is a mapping and no alias, and existing values can be replaced."""
    from ruamel.yaml import YAML

    node = YAML(typ="safe", pure=True).compose(text)
    for index, name in enumerate(keys):
        entry = _entry(node, name)
        if entry is None:
            if index < len(keys) - 1:
                raise RigctlError(f"'{name}' is not in the file", where=_location(node))
            return
        _check_place(*entry)
        if entry[1].id != "mapping" and entry[1].value:
            raise RigctlError(f"'{name}' is no mapping", where=_location(entry[0]))
        node = entry[1]
    for name in entries:
        entry = _entry(node, name)
        if entry is not None:
            _check_place(*entry)
            if _anchored(entry[1]):
                raise RigctlError(
                    f"'{name}' has an anchor, by which it may be shared with another part of the file",
                    hint="Write both out in their places first",
                    where=_location(entry[0]),
                )
            _check_comments(text, *entry)


def _entry(node: Any, name: str) -> tuple[Any, Any] | None:
    """Return the key and value nodes of an entry; None if there is no such entry."""
    if node is None or node.id != "mapping":
        return None
    return next(((key, value) for key, value in node.value if key.value == name), None)


def _check_place(key: Any, value: Any) -> None:
    """Refuse a value that is an alias: changing it would change other parts of the file."""
    if value.start_mark.index < key.end_mark.index:
        raise RigctlError(
            f"'{key.value}' is an alias of another part of the file",
            hint="Write it out in its place first",
            where=_location(key),
        )


def _anchored(node: Any) -> bool:
    """Return whether a value, or an item of a list, has an anchor for aliases in other parts of the file."""
    if node.anchor is not None:
        return True
    return node.id == "sequence" and any(_anchored(item) for item in node.value)


def _check_comments(text: str, key: Any, value: Any) -> None:
    """Refuse a list with a comment between its items, which would be lost."""
    if value.id != "scalar" and value.value:
        inside = text[value.start_mark.index : value.value[-1].start_mark.index]
        if any("#" in line for line in inside.splitlines()):
            raise RigctlError(
                f"a comment stands inside '{key.value}', and would be lost",
                hint="Move it above or behind",
                where=_location(key),
            )


def _location(node: Any) -> Location:
    return Location(None, node.start_mark.line + 1, node.start_mark.column + 1)
