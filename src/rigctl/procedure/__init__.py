"""Procedures: a file of steps, its arguments, and its expansion to a plan for a rig."""

from rigctl.procedure.expand import expand
from rigctl.procedure.load import Procedure, ProcedureFile, load_procedure, parse_procedure

__all__ = [
    "Procedure",
    "ProcedureFile",
    "expand",
    "load_procedure",
    "parse_procedure",
]
