"""`while`: a loop with a condition."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from rigctl.plan.context import Context
from rigctl.plan.fields import Condition
from rigctl.plan.step import Block
from rigctl.plan.tree import Loop, Node
from rigctl.plan.values import COUNT, Count


class WhileStep(Block):
    """Repeat as long as a condition holds; it is checked before each iteration."""

    verb: ClassVar[str] = "while"
    example: ClassVar[str] = "- while: oil_temperature < 25 degC\n  at_most: 100\n  do:\n    - wait: 10 s\n"
    while_: Condition = Field(alias="while", description="e.g. oil_temperature < 40 degC")
    at_most: Count = Field(
        default=COUNT.read("1000"), description="iterations, after which the step fails if it still holds"
    )

    def build(self, context: Context) -> Node:
        """Return a `Loop` with a condition."""
        condition = context.condition(self.while_, "while", answers=True)
        node = Loop(
            path=context.path,
            label=f"while {condition.text}",
            where=context.where(),
            body=context.body(self.do, "do"),
            count=None,
            condition=condition,
            max_iterations=int(context.si(self.at_most, "at_most")),
        )
        return context.with_cleanup(node, self)
