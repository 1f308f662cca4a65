"""Changes single entries of a YAML text, and leaves all other characters unchanged.

A path of keys leads through mappings, in block or flow style. Additions follow the style and, if possible,
the indentation of the existing text; a comment at the end of a changed line keeps its column.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from rigctl.errors import RigctlError

_COMMENT_AFTER = re.compile(r"([^#\"'\n]*?)( {2,})(#[^\n]*)")


@dataclass(frozen=True)
class Entry:
    """A key and its value, as nodes of the parser."""

    key: Any
    value: Any


class Text:
    """A YAML text whose entries are changed one after another."""

    def __init__(self, text: str) -> None:
        self.text = text
        self._newline = "\r\n" if "\r\n" in text else "\n"

    def has(self, *keys: str) -> bool:
        """Return whether the text has an entry under these keys."""
        return self._find(keys) is not None

    def names(self, *keys: str) -> list[str]:
        """Return the keys of the mapping under `keys`; none if it is missing or empty."""
        entries = _entries(self._value(keys))
        return [entry.key.value for entry in entries]

    def scalar(self, *keys: str) -> str | None:
        """Return the scalar under `keys`; None for anything else."""
        value = self._value(keys)
        return value.value if value is not None and value.id == "scalar" else None

    def is_mapping(self, *keys: str) -> bool:
        """Return whether there is a mapping under these keys."""
        value = self._value(keys)
        return value is not None and value.id == "mapping"

    def replace(self, keys: Sequence[str], new: str) -> None:
        """Replace the value under `keys` by `new`, in flow style."""
        entry = self._known(keys)
        if _is_empty(entry.value):
            self._splice(self._colon(entry) + 1, self._colon(entry) + 1, f" {new}")
        else:
            self._splice(entry.value.start_mark.index, self._end(entry), new)

    def rename(self, keys: Sequence[str], new: str) -> None:
        """Rename the key of the entry under `keys` to `new`."""
        key = self._known(keys).key
        self._splice(key.start_mark.index, key.end_mark.index, new)

    def insert(self, keys: Sequence[str], new: str) -> None:
        """Add an entry with the value `new`, in flow style, as the last of its mapping."""
        *above, name = keys
        if above and not self.has(*above):
            self.insert(above, "{}")
        if above and not self.is_mapping(*above):  # it has no value yet
            self.replace(above, "{}")
        mapping = self._value(above)
        entries, added = _entries(mapping), f"{name}: {new}"
        if mapping.flow_style and entries:
            self._splice(self._end(entries[-1]), self._end(entries[-1]), f", {added}")
        elif mapping.flow_style and above and self._above_is_block(above):
            self._open_block(above, added)
        elif mapping.flow_style:
            start = mapping.start_mark.index + 1
            self._splice(start, start, added)
        else:
            column = entries[0].key.start_mark.column
            self._insert_line(self._end(entries[-1]), " " * column + added)

    def remove(self, keys: Sequence[str]) -> None:
        """Remove the entry under `keys`; if it is the only one of its mapping, ``{}`` remains."""
        above = keys[:-1]
        mapping = self._value(above)
        entries = _entries(mapping)
        index = [entry.key.value for entry in entries].index(keys[-1])
        entry = entries[index]
        start, end = entry.key.start_mark.index, self._end(entry)
        if not mapping.flow_style:
            self._remove_lines(start, end)
            if len(entries) == 1:
                self.replace(above, "{}")
        elif index > 0:
            self._splice(self._end(entries[index - 1]), end, "")
        elif len(entries) > 1:
            self._splice(start, entries[1].key.start_mark.index, "")
        else:
            self._splice(start, end, "")

    def append(self, key: str, item: str) -> None:
        """Add an item to the list under a key of the top level."""
        value = self._value((key,))
        if value is None:
            self.insert((key,), f"[{item}]")
        elif _is_empty(value) or not value.value:
            self.replace((key,), f"[{item}]")
        elif value.flow_style:
            end = value.value[-1].end_mark.index
            self._splice(end, end, f", {item}")
        else:
            last = value.value[-1]
            self._insert_line(last.end_mark.index, " " * value.start_mark.column + f"- {item}")

    def _root(self) -> Any:
        return _composed(self.text)

    def _find(self, keys: Sequence[str]) -> Entry | None:
        value, found = self._root(), None
        for key in keys:
            found = next((entry for entry in _entries(value) if entry.key.value == key), None)
            if found is None:
                return None
            value = found.value
        return found

    def _known(self, keys: Sequence[str]) -> Entry:
        entry = self._find(keys)
        if entry is None:
            raise RigctlError("the file has no such entry", value=".".join(keys))
        return entry

    def _value(self, keys: Sequence[str]) -> Any:
        if not keys:
            return self._root()
        entry = self._find(keys)
        return None if entry is None else entry.value

    def _above_is_block(self, keys: Sequence[str]) -> bool:
        return not self._value(keys[:-1]).flow_style

    def _open_block(self, keys: Sequence[str], added: str) -> None:
        """Replace the empty ``{}`` under `keys` by a block with one entry."""
        entry = self._known(keys)
        start, end = entry.value.start_mark.index, entry.value.end_mark.index
        column = entry.key.start_mark.column + self._step()
        colon = self._colon(entry) + 1
        line_end = self._line_end(end)
        rest = self.text[end:line_end]
        self._splice(start, end, "")
        if not rest.strip():
            self.text = self.text[:colon] + self.text[self._line_end(colon) :]
        self._insert_line(colon, " " * column + added)

    def _step(self) -> int:
        """Return the indentation width of the file."""
        for entry in _entries(self._root()):
            below = _entries(entry.value)
            if below and not entry.value.flow_style:
                return int(below[0].key.start_mark.column) or 2
        return 2

    def _colon(self, entry: Entry) -> int:
        return self.text.index(":", int(entry.key.end_mark.index))

    def _end(self, entry: Entry) -> int:
        """Return the index after the last character of an entry."""
        value = entry.value
        if _is_empty(value):
            return self._colon(entry) + 1
        if value.id == "mapping" and not value.flow_style:
            return self._end(_entries(value)[-1])
        if value.id == "sequence" and not value.flow_style:
            return int(value.value[-1].end_mark.index)
        start, end = int(value.start_mark.index), int(value.end_mark.index)
        return start + len(self.text[start:end].rstrip())

    def _line_end(self, index: int) -> int:
        """Return the index of the end of the line, before its line break."""
        match = re.compile(r"\r?\n|\Z").search(self.text, index)
        return match.start() if match else len(self.text)

    def _insert_line(self, after: int, line: str) -> None:
        end = self._line_end(after)
        self.text = self.text[:end] + self._newline + line + self.text[end:]

    def _remove_lines(self, start: int, end: int) -> None:
        first = self.text.rfind("\n", 0, start) + 1
        last = self._line_end(end)
        following = re.compile(r"\r?\n").match(self.text, last)
        self.text = self.text[:first] + self.text[following.end() if following else last :]

    def _splice(self, start: int, end: int, new: str) -> None:
        """Replace the text between two indices by `new`, and keep the column of a comment that follows."""
        tail = self.text[end:]
        comment = _COMMENT_AFTER.match(tail)
        if comment is not None:
            room = len(
                comment[2]
            )  # at least two blanks before a comment that a long value has pushed to the right
            pad = " " * (max(room - len(new) + (end - start), 2) if room > 2 else 2)
            tail = comment[1] + pad + tail[comment.start(3) :]
        self.text = self.text[:start] + new + tail


def _entries(node: Any) -> list[Entry]:
    if node is None or node.id != "mapping":
        return []
    return [Entry(key, value) for key, value in node.value]


def _is_empty(node: Any) -> bool:
    """Return whether a key has no value."""
    return bool(node.id == "scalar" and node.start_mark.index == node.end_mark.index)


@lru_cache(maxsize=1)
def _composed(text: str) -> Any:
    """Return the nodes of a text with their positions; cached, since a change needs them several times."""
    from ruamel.yaml import YAML

    return YAML(typ="safe", pure=True).compose(text)
