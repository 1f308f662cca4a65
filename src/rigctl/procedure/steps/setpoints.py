"""`heat` and `set_pressure`: bring a quantity to a set-point and see that it stays there."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from rigctl.procedure.actions import Heat, SetLevel
from rigctl.procedure.context import Context
from rigctl.procedure.fields import Short
from rigctl.procedure.plan import Leaf
from rigctl.procedure.setpoints import check_level, check_set_point
from rigctl.procedure.shown import shown_time
from rigctl.procedure.steps.base import Part, Step
from rigctl.procedure.values import (
    DURATION,
    PERIOD,
    PRESSURE_TOLERANCE,
    TEMPERATURE_TOLERANCE,
    Duration,
    Period,
    Pressure,
    PressureTolerance,
    Temperature,
    TemperatureTolerance,
    Value,
)
from rigctl.units import show


class HeatFields(Part):
    """The oil is there when it has stayed inside the tolerance for `settle`."""

    to: Temperature = Field(description="the temperature wanted")
    within: TemperatureTolerance = Field(
        default=TEMPERATURE_TOLERANCE.read("0.5 K"), description="half width of the tolerance"
    )
    settle: Period = Field(default=PERIOD.read("60 s"), description="how long it must stay inside")
    timeout: Duration = Field(default=DURATION.read("2 h"), description="when the step fails")


class HeatStep(Step):
    """Heat the oil, or wait until it has cooled."""

    verb: ClassVar[str] = "heat"
    example: ClassVar[str] = "- heat: {to: 40 degC, within: 0.5 K, settle: 60 s, timeout: 2 h}\n"
    heat: Annotated[HeatFields, Short("to")]

    def build(self, context: Context) -> Leaf:
        """A `Heat` on the actuator and channel of the rig's role."""
        role = context.heat_role()
        fields = self.heat
        to = context.si(fields.to, "heat", "to")
        with context.located("heat", "to"):
            check_set_point(context.rig, role.channel, to)
        action = Heat(
            actuator=role.actuator,
            channel=role.channel,
            to=to,
            within=context.si(fields.within, "heat", "within"),
            settle=context.si(fields.settle, "heat", "settle"),
            timeout=context.si(fields.timeout, "heat", "timeout"),
        )
        unit = context.rig.channels[role.channel].unit
        label = (
            f"heat to {show(action.to, unit)} ± {show(action.within, 'K', difference=True)}, "
            f"settle {shown_time(action.settle)}"
        )
        return context.leaf(label, action)


class SetPressureFields(Part):
    """The pressure is there when it has stayed inside the tolerance for `settle`."""

    to: Pressure = Field(description="the supply pressure wanted")
    within: PressureTolerance = Field(
        default=PRESSURE_TOLERANCE.read("0.5 bar"), description="half width of the tolerance"
    )
    settle: Period = Field(default=PERIOD.read("2 s"), description="how long it must stay inside")
    timeout: Duration = Field(default=DURATION.read("60 s"), description="when the step fails")


class SetPressureStep(Step):
    """Set the supply pressure; where the valve is turned by hand, the operator is asked to."""

    verb: ClassVar[str] = "set_pressure"
    example: ClassVar[str] = "- set_pressure: {to: 30 bar, within: 0.5 bar, settle: 2 s, timeout: 60 s}\n"
    set_pressure: Annotated[SetPressureFields, Short("to")]

    def build(self, context: Context) -> Leaf:
        """A `SetLevel` on the actuator and channel of the rig's role."""
        role = context.pressure_role()
        fields = self.set_pressure

        def si(value: Value, name: str) -> float:
            return context.si(value, "set_pressure", name)

        action = SetLevel(
            actuator=role.actuator,
            channel=role.channel,
            to=si(fields.to, "to"),
            within=si(fields.within, "within"),
            settle=si(fields.settle, "settle"),
            timeout=si(fields.timeout, "timeout"),
        )
        with context.located("set_pressure", "to"):
            check_level(context.rig, role.actuator, action.to)
            check_set_point(context.rig, role.channel, action.to)
        unit = context.rig.channels[role.channel].unit
        by_hand = context.rig.actuators[role.actuator].by == "operator"
        label = (
            f"set pressure to {show(action.to, unit)} ± {show(action.within, unit)}"
            f"{' (operator)' if by_hand else ''}"
        )
        return context.leaf(label, action)
