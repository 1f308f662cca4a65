"""`do`: a group of steps with its cleanup."""

from __future__ import annotations

from typing import ClassVar

from rigctl.plan.context import Context
from rigctl.plan.step import Block
from rigctl.plan.tree import Group
from rigctl.wording import number_of


class DoStep(Block):
    """Execute steps in order; `finally`, `on_failure` and `on_abort` define the cleanup."""

    verb: ClassVar[str] = "do"
    example: ClassVar[str] = (
        "- do:\n    - set: {heater: on}\n    - wait: 5 min\n  finally:\n    - set: {heater: off}\n"
    )

    def build(self, context: Context) -> Group:
        """Return a `Group` with its cleanup."""
        count = len(self.do)
        label = f"do {number_of(count, 'step')}"
        return context.block(self.do, "do", label=label, cleanup=self)
