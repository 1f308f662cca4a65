"""A YAML document as nodes with their positions in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from rigctl.files.scalars import Scalar, read_plain

Key = str | int


@dataclass(slots=True)
class Node:
    """One value of a document; aliases share the node of their anchor.

    `line` and `column` count from 1. `size` and `height` are those of the value with every alias written out,
    so that a file that would explode is refused before it does.
    """

    line: int
    column: int
    size: int = 1
    height: int = 1

    def child(self, key: Key) -> Node | None:
        """The value under `key`, or None."""
        return None

    def plain(self) -> object:
        """The value as plain Python: dict, list, str, int, float, bool or None."""
        raise NotImplementedError

    def _grow(self, child: Node) -> None:
        self.size += child.size
        self.height = max(self.height, child.height + 1)


@dataclass(slots=True)
class ScalarNode(Node):
    """Text, number, true/false or nothing."""

    text: str = ""
    quoted: bool = False

    def plain(self) -> Scalar:
        """Quoted text is text; the rest is read by the core schema of YAML 1.2."""
        return self.text if self.quoted else read_plain(self.text)


@dataclass(slots=True)
class MappingNode(Node):
    """Keys and values, in the order of the file."""

    keys: dict[str, Node] = field(default_factory=dict)
    values: dict[str, Node] = field(default_factory=dict)

    def add(self, name: str, key: Node, value: Node) -> None:
        """Append one entry."""
        self.keys[name] = key
        self.values[name] = value
        self._grow(key)
        self._grow(value)

    def child(self, key: Key) -> Node | None:
        """The value under `key`."""
        return self.values.get(key) if isinstance(key, str) else None

    def plain(self) -> dict[str, object]:
        """A new dict."""
        return {name: value.plain() for name, value in self.values.items()}


@dataclass(slots=True)
class ListNode(Node):
    """Values in a row."""

    items: list[Node] = field(default_factory=list)

    def add(self, item: Node) -> None:
        """Append one value."""
        self.items.append(item)
        self._grow(item)

    def child(self, key: Key) -> Node | None:
        """The value at index `key`."""
        return self.items[key] if isinstance(key, int) and 0 <= key < len(self.items) else None

    def plain(self) -> list[object]:
        """A new list."""
        return [item.plain() for item in self.items]


def descend(root: Node, keys: Sequence[Key]) -> tuple[Node, Node]:
    """Follow `keys` as far as the document knows them.

    A key that the document does not contain is skipped: validators insert other names (the branch of a union,
    a missing field) among the keys of the file.

    Returns
    -------
    The last value reached, and the location of its key (of the value itself in a list and at the top).
    """
    value = place = root
    for key in known_keys(root, keys):
        found = value.child(key) or value
        place = value.keys[str(key)] if isinstance(value, MappingNode) else found
        value = found
    return value, place


def known_keys(root: Node, keys: Sequence[Key]) -> list[Key]:
    """The elements of `keys` that exist in the document, in order."""
    value, known = root, []
    for key in keys:
        found = value.child(key)
        if found is not None:
            known.append(key)
            value = found
    return known
