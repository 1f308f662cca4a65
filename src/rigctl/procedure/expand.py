"""Expands a procedure to a plan for a rig: sweeps and calls, with all variables resolved and checked."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from rigctl.argument_types import checks_argument_types
from rigctl.plan import GroupKind, Plan
from rigctl.plan.arguments import bind, read_arguments
from rigctl.plan.context import Context
from rigctl.plan.digest import digest
from rigctl.plan.reader import Findings
from rigctl.plan.value_text import shown_bindings
from rigctl.procedure.load import Procedure, load_procedure
from rigctl.rig import Rig


@checks_argument_types
def expand(procedure: Procedure, rig: Rig, arguments: Mapping[str, str | float] | None = None) -> Plan:
    """Everything that running the procedure on this rig would do.

    Parameters
    ----------
    arguments: as written, e.g. ``{"supply": "30 bar"}``; the others have their defaults.

    Raises
    ------
    RigctlError
        an argument is wrong, a step does not fit the rig, a set-point is beyond the rig's limits, a sweep is
        empty, a procedure calls itself, or the plan grows beyond 100 000 steps.
    """
    variables = bind(procedure, read_arguments(procedure, arguments or {}))
    context = Context(
        rig=rig,
        document=procedure.document,
        variables=variables,
        findings=Findings(),
        calls=(procedure,),
        load=cache(load_procedure),
    )
    root = context.block(procedure.steps, "steps", label=procedure.name, kind=GroupKind.ROOT)
    blocks = context.cleanup_groups(procedure, "")
    shown = shown_bindings(variables)
    return Plan(
        name=procedure.name,
        procedure=procedure,
        rig=rig,
        root=root,
        on_failure=blocks.get("on_failure"),
        on_abort=blocks.get("on_abort"),
        finally_=blocks.get("finally"),
        arguments=shown,
        digest=digest(root, *blocks.values()),
    )
