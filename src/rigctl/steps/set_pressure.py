"""`set_pressure`: adjust the supply pressure until its reading has settled at the set-point.

In: a pressure with a tolerance. Out: a `SetLevel` with its forecast and its behaviour. The same step
serves a bench whose valve is driven and one where a person turns it: a procedure need not be written
twice.

A person is asked by a notice, without an answer: the step goes on when the reading has stayed within the
tolerance, as it does for a driven valve, because the gauge and not a click shows that it has been done.
The level remains after the step (`lasting`), so a resumed run has to set it again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

from pydantic import Field

from rigctl.plan.action import Action, SetPoint
from rigctl.plan.behaviour import Behaviour, Question, StepBench, Until, every_sample
from rigctl.plan.context import Context
from rigctl.plan.fields import ProcedurePart, Short
from rigctl.plan.forecast import Basis, Forecast, ForecastBench, State
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.plan.setpoints import check_level, check_set_point
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.values import (
    DURATION,
    PERIOD,
    PRESSURE_TOLERANCE,
    Duration,
    Period,
    Pressure,
    PressureTolerance,
    Value,
)
from rigctl.steps.approach import approach, approach_time
from rigctl.steps.readings import reading
from rigctl.steps.settling import Settling, check_settling
from rigctl.units import show

#: assumed time for the response of a driven level, s, in addition to the settling time
_DRIVEN_LEVEL = 1.0
#: s assumed for a person to turn a valve until the gauge shows the set-point
_TURNING = 20.0


class SetPressureFields(ProcedurePart):
    """The pressure is reached when it has stayed within the tolerance for `settle`."""

    to: Pressure = Field(description="the desired supply pressure")
    within: PressureTolerance = Field(
        default=PRESSURE_TOLERANCE.read("0.5 bar"), description="half width of the tolerance"
    )
    settle: Period = Field(
        default=PERIOD.read("2 s"), description="how long the pressure must stay within the tolerance"
    )
    timeout: Duration = Field(default=DURATION.read("60 s"), description="after which the step fails")


class SetPressureStep(Step):
    """Set the supply pressure; if the valve is set by hand, the operator is asked to do so."""

    verb: ClassVar[str] = "set_pressure"
    example: ClassVar[str] = "- set_pressure: {to: 30 bar, within: 0.5 bar, settle: 2 s, timeout: 60 s}\n"
    set_pressure: Annotated[SetPressureFields, Short("to")]

    def build(self, context: Context) -> Leaf:
        """Return a `SetLevel` with the actuator and channel of the rig's role."""
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
        check_settling(context, "set_pressure", action.settle, action.timeout)
        unit = context.rig.channels[role.channel].unit
        by_hand = context.rig.actuators[role.actuator].by == "operator"
        label = (
            f"set pressure to {show(action.to, unit)} ± {show(action.within, unit)}"
            f"{' (operator)' if by_hand else ''}"
        )
        return context.leaf(label, action)


@dataclass(frozen=True, slots=True)
class SetLevel(Action):
    """Set a level, or ask the operator to do so, and wait until `channel` has settled at `to`."""

    actuator: str
    channel: str
    to: float  #: set-point of the channel, SI
    within: float  #: half width of the tolerance, SI
    settle: float  #: s within the tolerance before the step is done
    timeout: float  #: s until the step fails

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast the time that the actuator or the operator needs, plus the settling time."""
        by_hand = bench.rig.actuators[self.actuator].by == "operator"
        setting = bench.operator_time(_TURNING) if by_hand else _DRIVEN_LEVEL
        if not by_hand:
            before = state.levels.get(self.actuator, bench.rig.safe_state.get(self.actuator, 0.0))
            setting += approach_time(before, self.to, bench.rig.actuators[self.actuator].max_rate)
        total = setting + self.settle
        role = bench.rig.roles.set_pressure
        after = bench.pass_time(state, total)
        after = replace(after, levels={**state.levels, self.actuator: self.to})
        if role is not None and role.actuator == self.actuator:
            after = replace(after, pressure=self.to)
        reaches = {self.channel: (self.to - self.within, self.to + self.within)}
        basis = Basis.GUESSED if by_hand and not bench.simulated else Basis.ESTIMATED
        return Forecast(total, basis, after, reaches)

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Command the level, or ask the operator to set it, and monitor the channel until it has settled.

        Raises
        ------
        StepFailed
            the reading did not settle within `timeout` s; the message gives the readings.
        """
        actuator = bench.rig.actuators[self.actuator]
        target = reading(bench, self.channel, self.to)
        if actuator.by == "operator":
            yield from bench.command(self.actuator, self.to)
        else:
            yield from approach(bench, {self.actuator: self.to})
        if actuator.by == "operator":
            request = actuator.prompt or f"Turn {self.actuator} until {self.channel} reads"
            # A notice and no question: the readings show when it has been done, nobody has to confirm it.
            bench.request(Question(f"{request} {target}", notice=True))
        try:
            settling = Settling(self.to, self.within, self.settle)
            column = bench.columns[self.channel]
            give_up = bench.now + self.timeout
            row = yield Until(give_up, every_sample)
            while row is not None and not settling.add(row[0], row[column]):
                row = yield Until(give_up, every_sample)
        finally:
            bench.withdraw()
        if row is None:
            raise StepFailed(settling.gave_up(bench, self.channel, self.timeout), outcome=Outcome.TIMED_OUT)
        return Outcome.COMPLETE

    def settles_at(self) -> SetPoint:
        """Return the channel and its tolerance. It is no set-point of the channel, but of the actuator."""
        return SetPoint(self.channel, self.to, self.within)

    def lasting(self) -> frozenset[str]:
        """Return the actuator: its level remains after the step."""
        return frozenset({self.actuator})
