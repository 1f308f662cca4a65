"""`if`, `while` and `repeat`: what is decided while running, and what is done again and again."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from rigctl.procedure.context import Context
from rigctl.procedure.fields import Condition
from rigctl.procedure.plan import Branch, Loop, Node
from rigctl.procedure.steps.base import Block
from rigctl.procedure.values import COUNT, Count

if TYPE_CHECKING:
    from rigctl.procedure.steps.any_step import AnyStep


class IfStep(Block):
    """Choose by the newest sample, earlier measures and operators' answers."""

    verb: ClassVar[str] = "if"
    example: ClassVar[str] = (
        "- if: oil_temperature > 60 degC and heater == 0\n  do: [wait: 10 min]\n  else: [wait: 1 min]\n"
    )
    if_: Condition = Field(alias="if", description="e.g. oil_temperature > 40 degC")
    else_: list[AnyStep] | None = Field(default=None, alias="else", description="steps when it does not hold")

    def build(self, context: Context) -> Node:
        """A `Branch`."""
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


class WhileStep(Block):
    """Repeat as long as a condition holds; it is looked at before each round."""

    verb: ClassVar[str] = "while"
    example: ClassVar[str] = "- while: oil_temperature < 25 degC\n  at_most: 100\n  do:\n    - wait: 10 s\n"
    while_: Condition = Field(alias="while", description="e.g. oil_temperature < 40 degC")
    at_most: Count = Field(
        default=COUNT.read("1000"), description="rounds, after which the step fails if it still holds"
    )

    def build(self, context: Context) -> Node:
        """A `Loop` with a condition."""
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


class RepeatStep(Block):
    """Do the same a number of times; 0 leaves it out."""

    verb: ClassVar[str] = "repeat"
    example: ClassVar[str] = "- repeat: 3\n  do:\n    - extend: 0.5 s\n    - retract: 0.5 s\n"
    repeat: Count = Field(description="how often")

    def build(self, context: Context) -> Node:
        """A `Loop` with a count."""
        count = int(context.si(self.repeat, "repeat"))
        node = Loop(
            path=context.path,
            label=f"repeat {count} times" if count != 1 else "once",
            where=context.where(),
            body=context.repeated(count, "repeat").body(self.do, "do"),
            count=count,
            condition=None,
            max_iterations=count,
        )
        return context.with_cleanup(node, self)
