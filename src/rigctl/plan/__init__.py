"""The plan of a run, complete before anything moves: its tree, and the parts that steps are built from."""

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
    all_nodes,
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
    "all_nodes",
    "children",
    "cleanup_blocks",
    "iteration_path",
    "walk",
]
