"""The base classes of all steps; each kind of step is a separate module in `rigctl.steps`."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, ClassVar, TypeAlias

from pydantic import Field

from rigctl.plan.context import Context
from rigctl.plan.fields import ProcedurePart
from rigctl.plan.tree import Node


class Step(ProcedurePart):
    """One entry of a list of steps: a mapping whose first key, the verb, determines its kind."""

    verb: ClassVar[str]
    example: ClassVar[str]  #: for the reference page; a test expands it on `example_rig`
    example_rig: ClassVar[str] = "hl32-bench.yaml"  #: one of the shipped rigs

    @abstractmethod
    def build(self, context: Context) -> Node:
        """Return the node of the plan, with every variable resolved and checked against the rig.

        Raises
        ------
        RigctlError
            the step is not possible on the rig; with its location in the file.
        """


if TYPE_CHECKING:
    #: any kind of step; `rigctl.steps.registry` assembles the type to be read from all of them
    AnyStep: TypeAlias = Step


class Cleanup(ProcedurePart):
    """The steps that are carried out when a block is left, in whatever way."""

    on_failure: list[AnyStep] | None = Field(default=None, description="when one of its steps failed")
    on_abort: list[AnyStep] | None = Field(default=None, description="when the run was aborted inside it")
    finally_: list[AnyStep] | None = Field(
        default=None, alias="finally", description="in every case, after the others"
    )


class Block(Step, Cleanup):
    """A step that contains steps."""

    do: list[AnyStep] = Field(min_length=1, description="the steps")
