"""Reads a YAML file safely, with the positions of all its parts.

Only the events of the parser are used: nothing in a file can name a type, run code or refer to another
file. The size of the data is limited before they are built.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.errors import Location, RigctlError
from rigctl.files.nodes import Key, ListNode, MappingNode, Node, ScalarNode, descend
from rigctl.files.regular import regular

if TYPE_CHECKING:
    from ruamel.yaml.events import Event

MAX_BYTES = 1 << 20
MAX_DEPTH = 100
MAX_NODES = 100_000
#: largest text, in characters, whose nodes are cached
_SMALL = 1 << 16

# exceptions other than its own that the parser raises for invalid text
_PARSER_FAULTS = (ValueError, TypeError, LookupError, AttributeError, AssertionError, RecursionError)


@dataclass(frozen=True)
class Document:
    """A YAML document: its data as plain Python objects, its text, and the location of every part.

    One that is `generated` has no locations: no user could look them up.
    """

    path: Path | None
    text: str
    root: Node
    generated: bool = False

    @property
    def data(self) -> Any:
        """The document as dict, list, str, int, float, bool or None; new objects at each access."""
        return self.root.plain()

    def locate(self, keys: Sequence[Key] = (), *, of_key: bool = False) -> Location:
        """Return the location of the value under `keys`, or of its key with `of_key`.

        Keys that the document does not contain are skipped, so that a missing field is located at the mapping
        in which it is missing.
        """
        if self.generated:
            return Location()
        value, key = descend(self.root, keys)
        node = key if of_key else value
        return Location(self.path, node.line, node.column)

    def written(self, keys: Sequence[Key]) -> str | None:
        """Return the scalar under `keys` as the user wrote it; None for a mapping, a list, or no value."""
        value, _ = descend(self.root, keys)
        return value.text if isinstance(value, ScalarNode) else None


def read_document(path: Path) -> Document:
    """Read a YAML 1.2 file.

    Raises
    ------
    RigctlError
        the file cannot be read, is not UTF-8 or not valid YAML, repeats a key, uses tags or keys that are not
        text, is larger than 1 MiB, or has more than 100 levels or 100 000 values.
    """
    where = Location(path)
    try:
        if path.is_dir():  # opening a folder fails with a clear message on Linux, but not on Windows
            raise RigctlError("this is a folder", expected="a YAML file", where=where)
        if path.stat().st_size > MAX_BYTES:
            raise _too_large(where)
        with open(path, "rb", opener=regular) as file:  # read only up to the limit: it may grow
            content = file.read(MAX_BYTES + 1)
    except FileNotFoundError as problem:
        raise RigctlError("there is no such file", value=path.as_posix(), where=where) from problem
    except (OSError, ValueError) as problem:
        raise RigctlError(f"cannot read the file: {_reason(problem)}", where=where) from problem
    if len(content) > MAX_BYTES:
        raise _too_large(where)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        if b"\0" in content:
            raise RigctlError("this is not a text file", expected="a YAML file", where=where) from problem
        line = content.count(b"\n", 0, problem.start) + 1
        column = problem.start - content.rfind(b"\n", 0, problem.start)
        raise RigctlError(
            "the file is not UTF-8 text", expected="UTF-8", where=Location(path, line, column)
        ) from problem
    return parse_document(text, path)


def parse_document(text: str, path: Path | None = None) -> Document:
    """Read YAML 1.2 from text; `path` is its name in messages.

    Raises
    ------
    RigctlError
        as `read_document`.
    """
    if len(text) > MAX_BYTES:
        raise _too_large(Location(path))
    compose = _composed if len(text) <= _SMALL else _composed.__wrapped__
    try:
        return Document(path, text, compose(text))
    except RigctlError as error:
        error.at(Location(path))
        raise


@lru_cache(maxsize=64)
def _composed(text: str) -> Node:
    """Return the root of the document; cached, since its nodes are never changed.

    The parser takes 15 ms for a rig file, which a command reads several times, a server for every request.
    """
    return _Composer().compose(_events(text))


def _too_large(where: Location) -> RigctlError:
    return RigctlError("the file is too large", expected="at most 1 MiB", where=where)


def _reason(problem: Exception) -> str:
    return getattr(problem, "strerror", None) or str(problem)


def _events(text: str) -> Iterator[Event]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError
    from ruamel.yaml.reader import ReaderError

    events = YAML(typ="safe", pure=True).parse(text)
    try:
        yield from events
    except MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        where = Location(None, mark.line + 1, mark.column + 1) if mark else Location()
        what = " ".join(str(part) for part in (problem.context, problem.problem) if part)
        raise RigctlError(f"not valid YAML: {what}", where=where) from problem
    except ReaderError as problem:
        before = text[: int(problem.position)]
        where = Location(None, before.count("\n") + 1, len(before) - before.rfind("\n"))
        raise RigctlError(
            "not valid YAML: a control character", value=repr(problem.character), where=where
        ) from problem
    except (YAMLError, *_PARSER_FAULTS) as problem:
        raise RigctlError("not valid YAML") from problem


class _Composer:
    """Composes nodes from events, without recursion; refuses features that rigctl's files never need."""

    def __init__(self) -> None:
        self.anchors: dict[str, Node] = {}
        self.open: list[_Open] = []

    def compose(self, events: Iterator[Event]) -> Node:
        """Return the root of the only document in `events`."""
        from ruamel.yaml import events as kinds

        root: Node | None = None
        documents = 0
        for event in events:
            if isinstance(event, kinds.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self._refuse("there is a second document in the file", event, expected="only one")
                continue
            node = self._node(event)
            if node is None:
                continue
            if self.open:
                self._attach(node, event)
            else:
                root = node
        return root if root is not None else ScalarNode(1, 1)

    def _node(self, event: Event) -> Node | None:
        """Return the node that `event` completes; None if a mapping or list begins, and for other events."""
        from ruamel.yaml import events as kinds

        node: Node | None = None
        if isinstance(event, kinds.AliasEvent):
            node = self._alias(event)
        elif isinstance(event, kinds.ScalarEvent):
            self._check_tag(event)
            node = ScalarNode(*_place(event), text=event.value, quoted=event.style is not None)
            self._remember(event, node)
        elif isinstance(event, kinds.CollectionStartEvent):
            self._check_tag(event)
            if len(self.open) >= MAX_DEPTH:
                raise self._refuse("nested too deep", event, expected=f"at most {MAX_DEPTH} levels")
            mapping = isinstance(event, kinds.MappingStartEvent)
            container = MappingNode(*_place(event)) if mapping else ListNode(*_place(event))
            self.open.append(_Open(container, event))
        elif isinstance(event, kinds.CollectionEndEvent):
            done = self.open.pop()
            self._remember(done.started, done.container)
            node = done.container
        return node

    def _attach(self, node: Node, event: Event) -> None:
        top = self.open[-1]
        container = top.container
        if isinstance(container, ListNode):
            container.add(node)
        elif isinstance(container, MappingNode) and top.key is None:
            name = node.plain() if isinstance(node, ScalarNode) else None
            if not isinstance(name, str):
                raise self._refuse(
                    "a key must be text", event, value=getattr(node, "text", None), expected="a name"
                )
            if name in container.keys:
                first = container.keys[name].line
                raise self._refuse(f"the key is given twice, first in line {first}", event, value=name)
            top.key, top.name = node, name
        elif isinstance(container, MappingNode) and top.key is not None:
            container.add(top.name, top.key, node)
            top.key = None
        if container.size > MAX_NODES:
            raise self._refuse("the file grows too large", event, expected=f"at most {MAX_NODES} values")
        if container.height + len(self.open) > MAX_DEPTH + 1:
            raise self._refuse("nested too deep", event, expected=f"at most {MAX_DEPTH} levels")

    def _alias(self, event: Any) -> Node:
        node = self.anchors.get(event.anchor)
        if node is None:
            raise self._refuse("there is no such anchor before this line", event, value=f"*{event.anchor}")
        return node

    def _remember(self, event: Any, node: Node) -> None:
        if event.anchor is not None:
            self.anchors[event.anchor] = node

    def _check_tag(self, event: Any) -> None:
        # ruamel represents "no tag" by None, "" or a Tag object with either
        tag = str(event.tag or "")
        if tag:
            raise self._refuse("tags are not allowed", event, value=tag, expected="a plain value")

    def _refuse(
        self, what: str, event: Any, *, value: str | None = None, expected: str | None = None
    ) -> RigctlError:
        line, column = _place(event)
        return RigctlError(what, value=value, expected=expected, where=Location(None, line, column))


@dataclass(slots=True)
class _Open:
    """A mapping or list whose end has not been reached yet."""

    container: Node
    started: Any
    key: Node | None = None
    name: str = ""


def _place(event: Any) -> tuple[int, int]:
    return event.start_mark.line + 1, event.start_mark.column + 1
