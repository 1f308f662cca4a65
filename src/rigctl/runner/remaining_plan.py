"""The parts of a plan that are left to do, and the preceding steps that have to be repeated.

Used in two places: when a run is resumed (what earlier sessions have completed is left out), and when a
record is measured again after a loss. In both outputs were off meanwhile, so that the record would begin
in another state than the procedure asks for: the steps that set it up are done again, but no more than
those.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from rigctl.plan import Leaf, Loop, Node, RecordNode, children, iteration_path


@dataclass(frozen=True)
class Resume:
    """What an interrupted run has already done.

    Parameters
    ----------
    completed: paths of the records that are complete, with the rounds of their loops.
    values: measures and operators' answers by name: SI value, unit, and whether it is a difference.
    missed: measures that were outside their limits, one sentence each.
    """

    completed: frozenset[str]
    values: dict[str, tuple[float, str, bool]] = field(default_factory=dict)
    missed: tuple[str, ...] = ()


def record_paths(node: Node) -> list[str]:
    """The paths of every record below, one for each round of counted loops.

    A loop with a condition counts as one round, since their number is not known.
    """
    if isinstance(node, RecordNode):
        return [node.path]
    inner = [path for child in children(node) for path in record_paths(child)]
    if isinstance(node, Loop):
        rounds = range(1, (node.count if node.count is not None else 1) + 1)
        return [iteration_path(node, number, path) for number in rounds for path in inner]
    return inner


def remaining(nodes: Sequence[Node], done: Callable[[str], bool]) -> list[Node]:
    """The children of a group that are left to do, with the set-up steps on which they depend.

    Parameters
    ----------
    nodes: the children in order.
    done: whether the record of a path is complete.
    """
    records = [[done(path) for path in record_paths(node)] for node in nodes]
    if not any(any(states) for states in records):
        return list(nodes)
    # `first`: the first child with a record that is left. What comes before it is done.
    first = next((i for i, states in enumerate(records) if states and not all(states)), len(nodes))
    # A loop or a group of which some records are done. Its own set-up is found when its children are looked
    # at in the same way; from here only what lasts is needed.
    if first < len(nodes) and any(records[first]):  # its own first steps are past too
        return [*_lasting(nodes[:first]), *nodes[first:]]
    # Steps after the last complete record, and those of before whose setting is still in force.
    return [*setup_before(nodes, first), *nodes[first:]]


def setup_before(nodes: Sequence[Node], index: int) -> list[Node]:
    """The steps before `nodes[index]` on which its conditions depend.

    All steps since the last record before it, and of the earlier ones the last temperature, the last level
    and the last setting of each actuator.
    """
    past = [i for i, node in enumerate(nodes[:index]) if record_paths(node)]
    since = past[-1] + 1 if past else 0
    direct = list(nodes[since:index])
    return [*_lasting(nodes[:since], direct), *direct]


def _lasting(nodes: Sequence[Node], later: Sequence[Node] = ()) -> list[Node]:
    """The last step that sets each actuator permanently, unless a step of `later` does."""
    settled: set[str] = set()
    for node in later:
        settled |= _sets(node)
    steps: list[Node] = []
    # From the end, so that the last setting of each actuator wins, in the order of the procedure.
    for node in reversed(nodes):
        wanted = _sets(node) - settled
        if wanted:
            steps.insert(0, node)
            settled |= wanted
    return steps


def _sets(node: Node) -> frozenset[str]:
    """The actuators whose state a step sets permanently; none for a pulse or a move."""
    return node.action.lasting() if isinstance(node, Leaf) else frozenset()
