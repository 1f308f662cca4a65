"""A YAML document as nodes with their positions in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from rigctl.files.scalars import Scalar, read_plain

Key = str | int


@dataclass(slots=True)
class Node:
    """One value of a document; aliases share the node of their anchor.

    `line` and `column` count from 1. `size` and `height` are those of the value with every alias expanded, so
    that a file that would grow excessively is refused before it is expanded.
    """

    line: int
    column: int
    size: int = 1
    height: int = 1

    def child(self, key: Key) -> Node | None:
        """Return the value under `key`, or None."""
        return None

    def plain(self) -> object:
        """Return the value as a plain Python object: dict, list, str, int, float, bool or None."""
        raise NotImplementedError

    def _grow(self, child: Node) -> None:
        self.size += child.size
        self.height = max(self.height, child.height + 1)


@dataclass(slots=True)
class ScalarNode(Node):
    """A text, a number, true, false or null."""

    text: str = ""
    quoted: bool = False

    def plain(self) -> Scalar:
        """Return a quoted scalar as text, and any other as its value in the core schema of YAML 1.2."""
        return self.text if self.quoted else read_plain(self.text)


@dataclass(slots=True)
class MappingNode(Node):
    """A mapping, with its keys and values in the order of the file."""

    keys: dict[str, Node] = field(default_factory=dict)
    values: dict[str, Node] = field(default_factory=dict)

    def add(self, name: str, key: Node, value: Node) -> None:
        """Append one entry."""
        self.keys[name] = key
        self.values[name] = value
        self._grow(key)
        self._grow(value)

    def child(self, key: Key) -> Node | None:
        """Return the value under `key`, or None."""
        return self.values.get(key) if isinstance(key, str) else None

    def plain(self) -> dict[str, object]:
        """Return a new dict."""
        return {name: value.plain() for name, value in self.values.items()}


@dataclass(slots=True)
class ListNode(Node):
    """A list of values."""

    items: list[Node] = field(default_factory=list)

    def add(self, item: Node) -> None:
        """Append one value."""
        self.items.append(item)
        self._grow(item)

    def child(self, key: Key) -> Node | None:
        """Return the value at index `key`, or None."""
        return self.items[key] if isinstance(key, int) and 0 <= key < len(self.items) else None

    def plain(self) -> list[object]:
        """Return a new list."""
        return [item.plain() for item in self.items]


def descend(root: Node, keys: Sequence[Key]) -> tuple[Node, Node]:
    """Follow `keys`, skipping those that the document does not contain.

    Validators insert other names among the keys of the file: the branch of a union, or a missing field.

    Returns
    -------
    The last value reached, and the node of its key; for an item of a list and the root, the value itself.
    """
    value = place = root
    for key in known_keys(root, keys):
        found = value.child(key) or value
        place = value.keys[str(key)] if isinstance(value, MappingNode) else found
        value = found
    return value, place


def known_keys(root: Node, keys: Sequence[Key]) -> list[Key]:
    """Return the elements of `keys` that exist in the document, in order."""
    value, known = root, []
    for key in keys:
        found = value.child(key)
        if found is not None:
            known.append(key)
            value = found
    return known
