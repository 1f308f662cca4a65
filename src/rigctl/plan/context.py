"""The position in the plan at which a step is being built, and the construction of nodes there.

A `Context` is what a step gets when it builds its node: the rig and the variables (from `Reader`), the
place in the file, the path in the plan, the sweeps and calls around it. It is never changed; going deeper
makes a new one. Only `findings`, what earlier steps have measured or asked, is shared, since it grows in
the order of execution.

Plans are bounded in size, depth and rounds while they are built: a procedure may come from anywhere, and
a sweep in a sweep in a sweep is written in three lines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Protocol

from rigctl.errors import RigctlError
from rigctl.files.nodes import Key
from rigctl.files.yaml import Document
from rigctl.plan.action import Action
from rigctl.plan.arguments import Declaring
from rigctl.plan.reader import Reader
from rigctl.plan.tree import Group, GroupKind, Leaf, Node, ProcedureText
from rigctl.plan.values import Variables
from rigctl.project import find_project
from rigctl.units import Quantity

MAX_NODES = 100_000
#: largest nesting depth of steps, through calls: as deep as a single file can nest them
MAX_DEPTH = 50
#: largest number of repetitions of a step by all enclosing loops together
MAX_ROUNDS = 1_000_000


class Step(Protocol):
    """A step, which builds a node of the plan; see `rigctl.plan.step`."""

    verb: ClassVar[str]

    def build(self, context: Context) -> Node:
        """Return the node, with every variable resolved and checked against the rig."""
        ...


class Cleanup(Protocol):
    """The steps that are executed when a block is left."""

    @property
    def on_failure(self) -> Sequence[Step] | None:
        """The steps after a failure inside the block."""
        ...

    @property
    def on_abort(self) -> Sequence[Step] | None:
        """The steps after an abort of the run inside the block."""
        ...

    @property
    def finally_(self) -> Sequence[Step] | None:
        """The steps that are executed last, in every case."""
        ...


class Called(ProcedureText, Declaring, Cleanup, Protocol):
    """A procedure from which a plan is built: the requested one, or one that a step calls."""

    @property
    def document(self) -> Document:
        """The file, with the location of each entry."""
        ...

    @property
    def steps(self) -> Sequence[Step]:
        """Its steps."""
        ...


@dataclass(frozen=True, kw_only=True)
class Context(Reader):
    """A reader that knows its position in the plan."""

    path: str = ""  #: path of the step; empty at the top of the procedure
    sweep: Mapping[str, Quantity] = field(default_factory=dict)  #: of all enclosing sweeps, through calls
    recording: bool = False  #: True inside a record
    record_rate: float | None = None  #: sampling rate of the enclosing record, Hz
    depth: int = 0  #: number of enclosing steps
    rounds: int = 1  #: product of the rounds of the enclosing loops
    calls: tuple[Called, ...]  #: chain of calls from the requested procedure to this one
    load: Callable[[Path], Called]  #: reads the file of a procedure that is called

    def allow(self, more: int) -> None:
        """Refuse a plan that would exceed `MAX_NODES` with `more` further nodes."""
        if self.findings.nodes + more > MAX_NODES:
            raise RigctlError(
                "the plan grows too large",
                value=f"{self.findings.nodes + more} steps",
                expected=f"at most {MAX_NODES} steps",
            )

    def leaf(self, label: str, action: Action) -> Leaf:
        """Return the only node of a step."""
        return Leaf(self.path, label, self.where(), action)

    def body(self, steps: Sequence[Step], key: str) -> Group:
        """Return the steps under `key` as the body of a record, a loop or a branch."""
        prefix = self.path if key == "do" else f"{self.path}/{key}"
        children = self._steps(steps, key, prefix)
        return Group(f"{self.path}/{key}", key, self.where(key), children)

    def block(
        self,
        steps: Sequence[Step],
        key: str,
        *,
        label: str,
        kind: GroupKind = GroupKind.DO,
        bindings: Mapping[str, str] | None = None,
        cleanup: Cleanup | None = None,
    ) -> Group:
        """Return the steps under `key` as a group, which is the node of the step itself."""
        children = self._steps(steps, key, self.path)
        return self.collect(children, label=label, kind=kind, bindings=bindings, cleanup=cleanup)

    def collect(
        self,
        children: Sequence[Node],
        *,
        label: str,
        kind: GroupKind,
        bindings: Mapping[str, str] | None = None,
        cleanup: Cleanup | None = None,
        path: str | None = None,
    ) -> Group:
        """Return existing nodes as one group with its cleanup."""
        at = self.path if path is None else path
        blocks = self.cleanup_groups(cleanup, at)
        return Group(
            path=at or "procedure",
            label=label,
            where=self.where(),
            children=tuple(children),
            kind=kind,
            bindings=bindings or {},
            on_failure=blocks.get("on_failure"),
            on_abort=blocks.get("on_abort"),
            finally_=blocks.get("finally"),
        )

    def with_cleanup(self, node: Node, cleanup: Cleanup) -> Node:
        """Return the node itself, or a group around it if the step has cleanup blocks."""
        if not (cleanup.on_failure or cleanup.on_abort or cleanup.finally_):
            return node
        path = f"{self.path.rpartition('/')[0]}/block" if "/" in self.path else "block"
        return self.collect([node], label=node.label, kind=GroupKind.DO, cleanup=cleanup, path=path)

    def inside_record(self, rate: float) -> Context:
        """Return this context inside a record sampled at `rate` Hz."""
        return replace(self, recording=True, record_rate=rate)

    def repeated(self, count: int, key: str) -> Context:
        """Return this context inside a loop of `count` rounds."""
        rounds = self.rounds * max(count, 1)
        if rounds > MAX_ROUNDS:
            with self.located(key):
                raise RigctlError(
                    "repeated too often", value=f"{rounds} rounds", expected=f"at most {MAX_ROUNDS}"
                )
        return replace(self, rounds=rounds)

    def at_point(self, label: str, point: Mapping[str, Quantity]) -> Context:
        """Return this context at one point of a sweep."""
        with self.located("do"):
            self.allow(1)
        self.findings.nodes += 1
        return replace(
            self,
            path=f"{self.path}[{label}]",
            variables={**self.variables, **point},
            sweep={**self.sweep, **point},
        )

    def sweep_values(self) -> dict[str, tuple[float, str]]:
        """Return the values of every enclosing sweep, SI, with the units in which they are shown."""
        return {name: (value.si, value.unit.text or "1") for name, value in self.sweep.items()}

    def open_call(self, written: str) -> Called:
        """Read the procedure that a call names.

        Raises
        ------
        RigctlError
            there is no such file, it is not valid, or it calls itself, directly or indirectly; the message
            gives the chain of calls.
        """
        project = find_project(self.document.path.parent if self.document.path else None)
        path = project.resolve(written, relative_to=self.document.path)
        chain = [str(procedure.path) for procedure in self.calls]
        if any(_same_file(procedure.path, path) for procedure in self.calls):
            names = " calls ".join(Path(name).name for name in [*chain, str(path)])
            raise RigctlError("a procedure calls itself", value=names, expected="calls that come to an end")
        return self.load(path)

    def called(self, procedure: Called, variables: Variables) -> Context:
        """Return the context at the top of another procedure that is called from here."""
        return replace(
            self,
            document=procedure.document,
            keys=(),
            variables=variables,
            calls=(*self.calls, procedure),
        )

    def _steps(self, steps: Sequence[Step], key: str, prefix: str) -> tuple[Node, ...]:
        return tuple(self._step(step, (key, index), prefix) for index, step in enumerate(steps))

    def _step(self, step: Step, keys: tuple[Key, ...], prefix: str) -> Node:
        inner = replace(
            self,
            keys=(*self.keys, *keys),
            path=f"{prefix}/{int(keys[-1]) + 1}/{step.verb}".lstrip("/"),
            depth=self.depth + 1,
        )
        with inner.located():
            self.allow(1)
            if self.depth >= MAX_DEPTH:
                raise RigctlError(
                    "steps are nested too deep", expected=f"at most {MAX_DEPTH} inside each other"
                )
        self.findings.nodes += 1
        return step.build(inner)

    def cleanup_groups(self, cleanup: Cleanup | None, path: str) -> dict[str, Group]:
        """Return the cleanup blocks that are present, in the order in which they would run."""
        if cleanup is None:
            return {}
        named = {
            "on_failure": cleanup.on_failure,
            "on_abort": cleanup.on_abort,
            "finally": cleanup.finally_,
        }
        return {
            key: self._cleanup_group(steps, key, f"{path}/{key}".lstrip("/"))
            for key, steps in named.items()
            if steps
        }

    def _cleanup_group(self, steps: Sequence[Step], key: str, path: str) -> Group:
        """Return the group of one cleanup block."""
        children = self._steps(steps, key, path)
        return Group(path, key, self.where(key), children, kind=GroupKind.CLEANUP)


def _same_file(one: Path | None, other: Path) -> bool:
    return one is not None and one.resolve() == other.resolve()
