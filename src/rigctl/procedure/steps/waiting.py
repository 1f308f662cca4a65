"""`wait` and `hold`: let time pass, and watch that a channel stays where it is."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal
from rigctl.procedure.actions import Hold, Wait
from rigctl.procedure.context import Context
from rigctl.procedure.fields import Condition, Short
from rigctl.procedure.plan import Leaf
from rigctl.procedure.setpoints import check_set_point
from rigctl.procedure.shown import shown_time
from rigctl.procedure.steps.base import Part, Step
from rigctl.procedure.values import AnyTolerance, AnyValue, Duration, Period
from rigctl.units import show


class WaitFields(Part):
    """Either `for`, or `until` with a `timeout`."""

    for_: Period | None = Field(default=None, alias="for", description="how long")
    until: Condition | None = Field(default=None, description="a condition, e.g. oil_temperature < 40 degC")
    timeout: Duration | None = Field(default=None, description="with `until`: when the step fails")

    @model_validator(mode="after")
    def _one_end(self) -> Self:
        if (self.for_ is None) == (self.until is None):
            raise refusal(RigctlError("a wait needs one end", expected="either 'for' or 'until'"))
        if (self.until is None) != (self.timeout is None):
            what = "'until' needs a timeout" if self.until else "a timeout goes with 'until'"
            raise refusal(RigctlError(what, expected="e.g. '{until: position < 1 mm, timeout: 10 s}'"))
        return self


class WaitStep(Step):
    """Let time pass; recording and interlocks go on."""

    verb: ClassVar[str] = "wait"
    example: ClassVar[str] = "- wait: 0.2 s\n- wait: {until: oil_temperature < 40 degC, timeout: 3 h}\n"
    wait: Annotated[WaitFields, Short("for")]

    def build(self, context: Context) -> Leaf:
        """A `Wait`."""
        fields = self.wait
        until = context.condition(fields.until, "wait", "until") if fields.until else None
        action = Wait(
            duration=context.optional_si(fields.for_, "wait", "for"),
            until=until,
            timeout=context.optional_si(fields.timeout, "wait", "timeout"),
        )
        label = f"wait until {until.text}" if until else f"wait {shown_time(action.duration or 0.0)}"
        return context.leaf(label, action)


class HoldFields(Part):
    """The step fails as soon as the channel leaves the tolerance."""

    for_: Duration = Field(alias="for", description="how long")
    channel: str = Field(description="the channel to watch")
    at: AnyValue | None = Field(default=None, description="the value; by default what is read at the start")
    within: AnyTolerance = Field(description="half width of the tolerance")


class HoldStep(Step):
    """Wait, and see that a channel stays within a tolerance meanwhile."""

    verb: ClassVar[str] = "hold"
    example: ClassVar[str] = "- hold: {for: 1 min, channel: supply_pressure, at: 30 bar, within: 0.5 bar}\n"
    hold: HoldFields

    def build(self, context: Context) -> Leaf:
        """A `Hold`."""
        fields = self.hold
        channel = context.channel(fields.channel, "hold", "channel")
        at = context.optional_si(fields.at, "hold", "at", unit=channel.unit)
        if at is not None:
            with context.located("hold", "at"):
                check_set_point(context.rig, fields.channel, at)
        within = context.si(fields.within, "hold", "within", unit=channel.unit)
        action = Hold(context.si(fields.for_, "hold", "for"), fields.channel, at, within)
        place = f"at {show(at, channel.unit)} " if at is not None else ""
        label = (
            f"hold {fields.channel} {place}± {show(within, channel.unit, difference=True)} "
            f"for {shown_time(action.duration)}"
        )
        return context.leaf(label, action)
