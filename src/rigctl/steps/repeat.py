"""`repeat`: a loop with a count."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from rigctl.plan.context import Context
from rigctl.plan.step import Block
from rigctl.plan.tree import Loop, Node
from rigctl.plan.values import Count


class RepeatStep(Block):
    """Repeat steps a number of times; 0 leaves them out."""

    verb: ClassVar[str] = "repeat"
    example: ClassVar[str] = "- repeat: 3\n  do:\n    - extend: 0.5 s\n    - retract: 0.5 s\n"
    repeat: Count = Field(description="how often")

    def build(self, context: Context) -> Node:
        """Return a `Loop` with a count."""
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
