"""A procedure with its sweeps, calls and variables resolved: the tree that preview and runner both walk.

A node's `path` names it for good: it is built from the positions of the steps in the file and the values of
the sweeps, so the same procedure with the same arguments gives the same paths, and a resumed run finds its
place by them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Generic, Protocol, TypeAlias, TypeVar

from rigctl.errors import Location
from rigctl.expressions import Expression
from rigctl.notebook import one_line
from rigctl.plan.action import Action
from rigctl.plan.identity import IdentityFields
from rigctl.rig import Rig

T = TypeVar("T")


class ProcedureText(Protocol):
    """The procedure file that a plan was made from, as it is kept with a run."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    @property
    def path(self) -> Path | None:
        """The file it was read from."""
        ...

    @property
    def text(self) -> str:
        """The file's text."""
        ...

    @property
    def sha256(self) -> str:
        """The hash of the text, as hexadecimal digits."""
        ...

    @property
    def identity(self) -> IdentityFields:
        """What it says of the device under test, and demands to be told."""
        ...


class GroupKind(Enum):
    """Where a group comes from."""

    ROOT = "root"  #: the procedure itself, or one of its cleanup blocks
    DO = "do"  #: a `do` block, the body of a record, a loop or a branch
    FOR = "for"  #: a sweep; its children are its iterations
    ITERATION = "iteration"  #: one point of a sweep; `bindings` are its values
    CALL = "call"  #: another procedure; `bindings` are its arguments
    CLEANUP = "cleanup"  #: an `on_failure`, `on_abort` or `finally` block


@dataclass(frozen=True, slots=True)
class Group:
    """Nodes carried out one after the other, with the cleanup that belongs to them.

    `on_failure` runs when a child failed, `on_abort` when the run was aborted inside, `finally_` in every
    case and last. A failure goes on upwards after them.
    """

    path: str
    label: str
    where: Location
    children: tuple[Node, ...]
    kind: GroupKind = GroupKind.DO
    bindings: Mapping[str, str] = field(default_factory=dict)  #: as a person reads them
    on_failure: Group | None = None
    on_abort: Group | None = None
    finally_: Group | None = None


@dataclass(frozen=True, slots=True)
class Leaf:
    """One step that asks something of the bench."""

    path: str
    label: str
    where: Location
    action: Action


@dataclass(frozen=True, slots=True)
class Loop:
    """A body carried out again and again: `count` times, or while a condition holds before each round.

    It is unrolled while running. A loop with a condition fails when it still holds after `max_iterations`.
    """

    path: str
    label: str
    where: Location
    body: Group
    count: int | None
    condition: Expression | None
    max_iterations: int


@dataclass(frozen=True, slots=True)
class Branch:
    """A choice made while running, from the newest sample, earlier measures and operators' answers."""

    path: str
    label: str
    where: Location
    condition: Expression
    then: Group
    otherwise: Group | None


@dataclass(frozen=True, slots=True)
class RecordNode:
    """One excitation that is recorded: the unit of fitting and of hold-out."""

    path: str
    label: str
    where: Location
    name: str
    rate: float  #: Hz
    channels: tuple[str, ...]
    sweep: Mapping[str, tuple[float, str]]  #: name to SI value and the unit it is shown in
    body: Group
    retries: int = 0  #: how often it is repeated when the bench was lost inside it


Node: TypeAlias = Group | Leaf | Loop | Branch | RecordNode


class Visitor(ABC, Generic[T]):
    """Something to be done at every kind of node; what goes below one visits it itself."""

    def visit(self, node: Node) -> T:
        """What is done at a node, by its kind."""
        match node:
            case Leaf():
                return self.leaf(node)
            case Group():
                return self.group(node)
            case RecordNode():
                return self.record(node)
            case Loop():
                return self.loop(node)
            case Branch():
                return self.branch(node)

    @abstractmethod
    def leaf(self, node: Leaf) -> T:
        """At one step."""

    @abstractmethod
    def group(self, node: Group) -> T:
        """At nodes one after the other."""

    @abstractmethod
    def record(self, node: RecordNode) -> T:
        """At what is recorded."""

    @abstractmethod
    def loop(self, node: Loop) -> T:
        """At what is repeated."""

    @abstractmethod
    def branch(self, node: Branch) -> T:
        """At a choice."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything a run will do, decided before anything moves."""

    name: str
    procedure: ProcedureText
    rig: Rig
    root: Group
    on_failure: Group | None
    on_abort: Group | None
    finally_: Group | None
    arguments: Mapping[str, str]  #: as a person reads them, with units
    digest: str  #: SHA-256 over the tree: equal plans do equal things

    def __repr__(self) -> str:
        """What it is of, on one line."""
        given = "".join(f", {name} = {value}" for name, value in self.arguments.items())
        return one_line(self, f"{self.name} on {self.rig.name}{given}")


def children(node: Node) -> tuple[Node, ...]:
    """The nodes directly below, cleanup blocks left out."""
    match node:
        case Group():
            return node.children
        case Loop() | RecordNode():
            return (node.body,)
        case Branch():
            return (node.then,) if node.otherwise is None else (node.then, node.otherwise)
        case Leaf():
            return ()


def cleanup_blocks(node: Group) -> tuple[Group, ...]:
    """The cleanup blocks of a group that exist, in the order in which they would run."""
    return tuple(block for block in (node.on_failure, node.on_abort, node.finally_) if block is not None)


def walk(node: Node) -> Iterator[Node]:
    """The node and everything below it in order of execution; cleanup blocks left out."""
    stack = [node]
    while stack:
        current = stack.pop()
        yield current
        stack.extend(reversed(children(current)))


def iteration_path(loop: Loop, iteration: int, path: str) -> str:
    """The path of a node inside a loop in one of its rounds, counted from 1.

    ``2/repeat/1/record`` inside the loop ``2/repeat`` is ``2/repeat#3/1/record`` in the third round.
    """
    return f"{loop.path}#{iteration}{path.removeprefix(loop.path)}"
