"""What to do: the schema of a procedure's steps, and its expansion to a plan."""

from rigctl.procedure.expand import expand
from rigctl.procedure.load import Procedure, ProcedureFile, load_procedure, parse_procedure
from rigctl.procedure.plan import Branch, Group, GroupKind, Leaf, Loop, Node, Plan, RecordNode

__all__ = [
    "Branch",
    "Group",
    "GroupKind",
    "Leaf",
    "Loop",
    "Node",
    "Plan",
    "Procedure",
    "ProcedureFile",
    "RecordNode",
    "expand",
    "load_procedure",
    "parse_procedure",
]
