"""`if`: a branch that is chosen during the run."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from rigctl.plan.context import Context
from rigctl.plan.fields import Condition
from rigctl.plan.step import Block
from rigctl.plan.tree import Branch, Node

if TYPE_CHECKING:
    from rigctl.plan.step import AnyStep


class IfStep(Block):
    """Branch on the latest sample, earlier measures and operators' answers."""

    verb: ClassVar[str] = "if"
    example: ClassVar[str] = (
        "- if: oil_temperature > 60 degC and heater == 0\n  do: [wait: 10 min]\n  else: [wait: 1 min]\n"
    )
    if_: Condition = Field(alias="if", description="e.g. oil_temperature > 40 degC")
    else_: list[AnyStep] | None = Field(default=None, alias="else", description="steps if it does not hold")

    def build(self, context: Context) -> Node:
        """Return a `Branch`."""
        condition = context.condition(self.if_, "if", answers=True)
        node = Branch(
            path=context.path,
            label=f"if {condition.text}",
            where=context.where(),
            condition=condition,
            then=context.body(self.do, "do"),
            otherwise=context.body(self.else_, "else") if self.else_ else None,
        )
        return context.with_cleanup(node, self)
