"""The position of a run in its plan: the step in progress, its surroundings, and its record."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

from rigctl.plan import (
    Branch,
    Group,
    GroupKind,
    Loop,
    Node,
    Plan,
    RecordNode,
    children,
    cleanup_blocks,
)

_ROUND = re.compile(r"#(\d+)")


class Stage(Enum):
    """Whether a step has been carried out."""

    DONE = "done"  #: it is before the step in progress
    CURRENT = "current"  #: it, or something in it, is in progress
    AHEAD = "ahead"  #: it is after the step in progress


@dataclass(frozen=True)
class StepLine:
    """One line of the tree: its text, its indentation, and whether it is done."""

    depth: int
    label: str
    stage: Stage
    note: str = ""  #: e.g. ``3 of 7``


class PlanPlaces:
    """Finds steps of a plan by their paths."""

    def __init__(self, plan: Plan) -> None:
        self._above: dict[str, tuple[Node, Node | None]] = {}
        for root in (plan.root, plan.on_failure, plan.on_abort, plan.finally_):
            if root is not None:
                self._add(root, None)

    def _add(self, root: Node, above: Node | None) -> None:
        waiting: list[tuple[Node, Node | None]] = [(root, above)]
        while waiting:
            node, parent = waiting.pop()
            self._above.setdefault(node.path, (node, parent))
            waiting.extend((child, node) for child in children(node))
            if isinstance(node, Branch) and node.otherwise is not None:
                waiting.append((node.otherwise, node))
            if isinstance(node, Group):
                waiting.extend((block, node) for block in cleanup_blocks(node))

    def chain(self, path: str) -> list[Node]:
        """From the root down to the step with this path, rounds of loops left out; empty when unknown."""
        nodes: list[Node] = []
        node, above = self._above.get(_ROUND.sub("", path), (None, None))
        while node is not None:
            nodes.append(node)
            node, above = self._above[above.path] if above is not None else (None, None)
        return nodes[::-1]

    def record(self, path: str) -> RecordNode | None:
        """The record that the step belongs to."""
        return next((node for node in self.chain(path) if isinstance(node, RecordNode)), None)


def outline(steps: PlanPlaces, path: str, most: int) -> list[StepLine]:
    """The tree around the step in progress, in about `most` lines.

    Sweeps show the point in progress and its number; as many steps beside the current one as fit are shown,
    nearest first.
    """
    chain = steps.chain(path)
    if not chain:
        return []
    rounds = _rounds(path)
    levels = [level for level in _levels(chain) if level[0]]
    room = max(most - len(levels), 0)
    beside = _share([len(siblings) - 1 for siblings, _ in levels], room)
    before: list[StepLine] = []
    after: list[StepLine] = []
    for depth, ((siblings, current), count) in enumerate(zip(levels, beside, strict=True)):
        index = siblings.index(current)
        first, last = _window(index, len(siblings), count)
        before += [StepLine(depth, node.label, Stage.DONE) for node in siblings[first:index]]
        before.append(StepLine(depth, current.label, Stage.CURRENT, _note(current, chain, rounds)))
        after = [StepLine(depth, node.label, Stage.AHEAD) for node in siblings[index + 1 : last]] + after
    return before + after


def _levels(chain: Sequence[Node]) -> Iterator[tuple[list[Node], Node]]:
    """From the root down: the steps at one level, and which of them leads to the current one.

    A block that only groups its steps has no line, and neither have the other points of a sweep.
    """
    for above, node in pairwise(chain):
        if isinstance(node, Group) and node.kind is GroupKind.DO and isinstance(above, RecordNode | Loop):
            continue
        if isinstance(above, Group) and above.kind is GroupKind.FOR:
            yield [node], node
        else:
            siblings = list(children(above))
            yield (siblings if node in siblings else [node]), node


def _note(node: Node, chain: Sequence[Node], rounds: dict[str, int]) -> str:
    """The progress of a sweep or a loop."""
    if isinstance(node, Loop):
        number = rounds.get(node.path)
        of = f" of {node.count}" if node.count is not None else ""
        return f"round {number}{of}" if number else ""
    if isinstance(node, Group) and node.kind is GroupKind.ITERATION:
        index = next((index for index, other in enumerate(chain) if other is node), 0)
        points = children(chain[index - 1]) if index else (node,)
        return f"{points.index(node) + 1} of {len(points)}"
    return ""


def _rounds(path: str) -> dict[str, int]:
    """The round of every loop on the path, by the loop's own path."""
    return {_ROUND.sub("", path[: match.start()]): int(match.group(1)) for match in _ROUND.finditer(path)}


def _share(wanted: Sequence[int], room: int) -> list[int]:
    """Distribute the available lines to the levels, the innermost first."""
    shares = []
    for count in reversed(wanted):
        shares.append(min(count, room))
        room -= shares[-1]
    return shares[::-1]


def _window(index: int, count: int, beside: int) -> tuple[int, int]:
    """First and last (exclusive) of the `beside` neighbours of `index`, a third of them before it."""
    before = min(index, max(beside // 3, beside - (count - 1 - index)))
    return index - before, min(index + 1 + beside - before, count)
