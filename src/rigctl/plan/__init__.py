"""What a run will do, laid out before anything moves: the tree of a plan, and what steps are built from."""

from rigctl.plan.tree import (
    Branch,
    Group,
    GroupKind,
    Leaf,
    Loop,
    Node,
    Plan,
    RecordNode,
    Visitor,
    children,
    cleanup_blocks,
    iteration_path,
    walk,
)

__all__ = [
    "Branch",
    "Group",
    "GroupKind",
    "Leaf",
    "Loop",
    "Node",
    "Plan",
    "RecordNode",
    "Visitor",
    "children",
    "cleanup_blocks",
    "iteration_path",
    "walk",
]
