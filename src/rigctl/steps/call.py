"""`call`: carry out another procedure with given arguments."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar

from pydantic import Field

from rigctl.errors import RigctlError
from rigctl.plan.arguments import bind
from rigctl.plan.context import Context
from rigctl.plan.fields import Name, ProcedurePart, Short
from rigctl.plan.step import Cleanup, Step
from rigctl.plan.tree import GroupKind, Node
from rigctl.plan.value_text import shown_bindings
from rigctl.plan.values import AnyValue, Variable


class CallFields(ProcedurePart):
    """The called procedure sees only its arguments."""

    procedure: str = Field(min_length=1, description="its file, relative to this file or to the project")
    with_: dict[Name, AnyValue | list[AnyValue]] = Field(
        default_factory=dict, alias="with", description="argument: value"
    )


class CallStep(Step, Cleanup):
    """Execute the steps of another procedure, with its own cleanup, on the caller's rig."""

    verb: ClassVar[str] = "call"
    example: ClassVar[str] = "- call: {procedure: procedures/stroke.yaml, with: {supply: 40 bar}}\n"
    call: Annotated[CallFields, Short("procedure")]

    def build(self, context: Context) -> Node:
        """Return a group with the steps of the other procedure."""
        fields = self.call
        with context.located("call", "procedure"):
            procedure = context.open_call(fields.procedure)
        given: dict[str, Variable] = {}
        for name, value in fields.with_.items():
            given[name] = (
                tuple(context.quantity(item, "call", "with", name, i) for i, item in enumerate(value))
                if isinstance(value, list)
                else context.variable(value, "call", "with", name)
            )
        with context.located("call", "with"):
            variables = bind(procedure, given)
        inner = context.called(procedure, variables)
        try:
            body = inner.block(
                procedure.steps,
                "steps",
                label=f"call {procedure.name}",
                kind=GroupKind.CALL,
                bindings=shown_bindings(variables),
                cleanup=procedure,
            )
        except RigctlError as error:
            error.hint = ". ".join(part for part in (error.hint, f"Called from {context.where()}") if part)
            raise
        return context.with_cleanup(replace(body, where=context.where()), self)
