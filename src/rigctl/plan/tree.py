"""A procedure with its sweeps, calls and variables resolved: the tree that both preview and runner traverse.

A node's `path` is a permanent name: it is composed of the positions of the steps in the file and the values
of the sweeps, so that the same procedure with the same arguments has the same paths, by which a resumed run
finds its position.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
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
from rigctl.plan.missing import MOST_MISSING
from rigctl.rig import Rig

T = TypeVar("T")


class ProcedureText(Protocol):
    """The procedure file from which a plan was made, as it is stored with a run."""

    @property
    def name(self) -> str:
        """Its name."""
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
        """Its fields for the device under test."""
        ...


class GroupKind(Enum):
    """The origin of a group."""

    ROOT = "root"  #: the procedure itself, or one of its cleanup blocks
    DO = "do"  #: a `do` block, the body of a record, a loop or a branch
    FOR = "for"  #: a sweep; its children are its iterations
    ITERATION = "iteration"  #: one point of a sweep; `bindings` are its values
    CALL = "call"  #: another procedure; `bindings` are its arguments
    CLEANUP = "cleanup"  #: an `on_failure`, `on_abort` or `finally` block


@dataclass(frozen=True, slots=True)
class Group:
    """Nodes that are executed one after the other, with their cleanup.

    `on_failure` runs if a child has failed, `on_abort` if the run was aborted inside the group, and
    `finally_` last and in every case. A failure then propagates upwards.
    """

    path: str
    label: str
    where: Location
    children: tuple[Node, ...]
    kind: GroupKind = GroupKind.DO
    bindings: Mapping[str, str] = field(default_factory=dict)  #: as text
    on_failure: Group | None = None
    on_abort: Group | None = None
    finally_: Group | None = None


@dataclass(frozen=True, slots=True)
class Leaf:
    """One step that acts on the bench."""

    path: str
    label: str
    where: Location
    action: Action


@dataclass(frozen=True, slots=True)
class Loop:
    """A body that is executed repeatedly: `count` times, or while a condition holds before each round.

    It is unrolled during the run. A loop with a condition fails if that still holds after `max_iterations`.
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
    """A choice made during the run, by the latest sample, earlier measures and operators' answers."""

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
    sweep: Mapping[str, tuple[float, str]]  #: SI value and unit for display, by name
    body: Group
    retries: int = 0  #: permitted number of repetitions after a loss of contact
    most_missing: float = MOST_MISSING  #: permitted share of missing samples or readings


Node: TypeAlias = Group | Leaf | Loop | Branch | RecordNode


class Visitor(ABC, Generic[T]):
    """A visitor with a method for each kind of node; each method decides whether to descend."""

    def visit(self, node: Node) -> T:
        """Visit a node by its kind."""
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
        """Visit a leaf."""

    @abstractmethod
    def group(self, node: Group) -> T:
        """Visit a group."""

    @abstractmethod
    def record(self, node: RecordNode) -> T:
        """Visit a record."""

    @abstractmethod
    def loop(self, node: Loop) -> T:
        """Visit a loop."""

    @abstractmethod
    def branch(self, node: Branch) -> T:
        """Visit a branch."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything a run will do, determined before anything moves."""

    name: str
    procedure: ProcedureText
    rig: Rig
    root: Group
    on_failure: Group | None
    on_abort: Group | None
    finally_: Group | None
    arguments: Mapping[str, str]  #: as text, with units
    digest: str  #: SHA-256 over the tree: equal for plans that do the same

    def __repr__(self) -> str:
        """The name of the procedure with its arguments, on one line."""
        given = "".join(f", {name} = {value}" for name, value in self.arguments.items())
        return one_line(self, f"{self.name} on {self.rig.name}{given}")


def children(node: Node) -> tuple[Node, ...]:
    """Return the nodes directly below, without cleanup blocks."""
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
    """Return the cleanup blocks of a group, in the order in which they would run."""
    return tuple(block for block in (node.on_failure, node.on_abort, node.finally_) if block is not None)


def walk(node: Node) -> Iterator[Node]:
    """Yield the node and all nodes below it in order of execution, without cleanup blocks."""
    stack = [node]
    while stack:
        current = stack.pop()
        yield current
        stack.extend(reversed(children(current)))


def all_nodes(plan: Plan) -> Iterator[Node]:
    """Yield every node of a plan, those of cleanup blocks after the others."""
    blocks = (plan.root, plan.on_failure, plan.on_abort, plan.finally_)
    waiting = deque(block for block in blocks if block is not None)
    while waiting:
        for node in walk(waiting.popleft()):
            yield node
            if isinstance(node, Group):
                waiting.extend(cleanup_blocks(node))


def iteration_path(loop: Loop, iteration: int, path: str) -> str:
    """Return the path of a node in one round of a loop, counted from 1.

    ``2/repeat/1/record`` inside the loop ``2/repeat`` is ``2/repeat#3/1/record`` in the third round.
    """
    return f"{loop.path}#{iteration}{path.removeprefix(loop.path)}"
