"""Change a few values in a YAML file and leave every other byte of it as it is: comments, order, alignment.

The parser of ruamel.yaml says where each value stands; only those stretches of text are replaced.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rigctl.errors import Location, RigctlError


def set_entries(text: str, keys: Sequence[str], entries: Mapping[str, str]) -> str:
    """The text with `entries` in the mapping under `keys`, which is made where it is missing.

    Parameters
    ----------
    text: a YAML document whose top is a mapping.
    keys: from the top to the mapping; all but the last must be there.
    entries: name to value, the value as YAML in one line.

    Raises
    ------
    RigctlError
        a part of the way is missing, is no mapping, or stands elsewhere in the file (an alias).
    """
    from ruamel.yaml import YAML

    root = YAML(typ="rt", pure=True).compose(text)
    parent = _descend(root, keys[:-1])
    entry = _entry(parent, keys[-1])
    if entry is None:
        written = ", ".join(f"{name}: {value}" for name, value in entries.items())
        return _inserted(text, parent, {keys[-1]: f"{{{written}}}"})
    key, mapping = entry
    _check_mapping(key, mapping, keys[-1])
    found = {name: _entry(mapping, name) for name in entries}
    missing = {name: entries[name] for name, at in found.items() if at is None}
    changed = _inserted(text, mapping, missing) if missing else text
    # what was inserted stands behind all that is replaced, so places still hold; from the last to the first
    present = [(at, entries[name]) for name, at in found.items() if at is not None]
    for (name_node, value), new in sorted(present, key=lambda one: -one[0][1].start_mark.index):
        _check_place(name_node, value)
        changed = _replaced(changed, name_node, value, new)
    return changed


def _descend(root: Any, keys: Sequence[str]) -> Any:
    node = root
    for key in keys:
        entry = _entry(node, key)
        if entry is None:
            raise RigctlError(f"'{key}' is not in the file")
        _check_mapping(*entry, key)
        node = entry[1]
    return node


def _entry(mapping: Any, name: str) -> tuple[Any, Any] | None:
    """Key and value nodes of an entry."""
    from ruamel.yaml.nodes import MappingNode

    if not isinstance(mapping, MappingNode):
        raise RigctlError("a mapping is expected here", where=_location(mapping))
    return next(((key, value) for key, value in mapping.value if key.value == name), None)


def _check_mapping(key: Any, value: Any, name: str) -> None:
    from ruamel.yaml.nodes import MappingNode

    _check_place(key, value)
    if not isinstance(value, MappingNode):
        raise RigctlError(f"'{name}' is no mapping", where=_location(key))


def _check_place(key: Any, value: Any) -> None:
    """Refuse a value that is written elsewhere: changing it would change more than what is meant."""
    if value.start_mark.index < key.end_mark.index:
        raise RigctlError(
            f"'{key.value}' is an alias of another part of the file",
            hint="Write it out in its place first",
            where=_location(key),
        )


def _location(node: Any) -> Location:
    return Location(None, node.start_mark.line + 1, node.start_mark.column + 1)


def _replaced(text: str, key: Any, value: Any, new: str) -> str:
    """The text with another value for one key."""
    start, end = value.start_mark.index, _end(text, value)
    if any("#" in line for line in text[start:end].splitlines()[:-1]):
        raise RigctlError(
            f"a comment stands inside '{key.value}', and would be lost",
            hint="Move it above or behind",
            where=_location(key),
        )
    before = text[:start]
    if start == end and not before.endswith((" ", "\t")):  # an empty value
        before += " "
    if "\n" in text[key.end_mark.index : start]:  # a block below its key: the new value goes beside it
        before = text[: key.end_mark.index] + text[key.end_mark.index :].partition(":")[0] + ": "
    return before + new + text[end:]


def _end(text: str, node: Any) -> int:
    """Where a value's own text ends: a block's mark lies behind comments and blank lines that follow it."""
    from ruamel.yaml.nodes import ScalarNode

    index = int(node.end_mark.index)
    if isinstance(node, ScalarNode) and node.style in ("|", ">"):
        return len(text[:index].rstrip())
    if not isinstance(node, ScalarNode) and not node.flow_style:
        last = node.value[-1]
        return _end(text, last[1] if isinstance(last, tuple) else last)
    return index


def _inserted(text: str, mapping: Any, entries: Mapping[str, str]) -> str:
    """The text with new entries at the end of a mapping."""
    if mapping.flow_style:
        written = ", ".join(f"{name}: {value}" for name, value in entries.items())
        close = int(mapping.end_mark.index) - 1
        inside = text[: len(text[:close].rstrip())]
        comma = ", " if mapping.value and not inside.endswith(",") else ""
        if not comma and inside.endswith(","):
            comma = " "
        return inside + comma + written + text[len(inside) :]
    if not mapping.value:
        raise RigctlError("an empty mapping is expected to be written {}", where=_location(mapping))
    column = mapping.value[0][0].start_mark.column
    end = _end(text, mapping)
    line_end = text.find("\n", end)
    newline = "\r\n" if "\r\n" in text else "\n"
    at = len(text) if line_end < 0 else line_end - (text[line_end - 1] == "\r")
    lines = "".join(f"{newline}{' ' * column}{name}: {value}" for name, value in entries.items())
    return text[:at] + lines + text[at:]
