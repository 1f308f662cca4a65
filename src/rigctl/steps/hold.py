"""`hold`: wait, while checking that a channel stays within a tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pydantic import Field

from rigctl.plan.action import Action, SetPoint
from rigctl.plan.behaviour import Behaviour, Row, StepBench, Until
from rigctl.plan.context import Context
from rigctl.plan.fields import ProcedurePart
from rigctl.plan.forecast import Basis, Extents, Forecast, ForecastBench, State
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.plan.setpoints import check_set_point
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.value_text import shown_time
from rigctl.plan.values import AnyTolerance, AnyValue, Duration
from rigctl.steps.readings import reading
from rigctl.units import show


class HoldFields(ProcedurePart):
    """The step fails as soon as the channel leaves the tolerance."""

    for_: Duration = Field(alias="for", description="how long")
    channel: str = Field(description="the channel to monitor")
    at: AnyValue | None = Field(default=None, description="the value; by default the reading at the start")
    within: AnyTolerance = Field(description="half width of the tolerance")


class HoldStep(Step):
    """Wait while a channel stays within a tolerance."""

    verb: ClassVar[str] = "hold"
    example: ClassVar[str] = "- hold: {for: 1 min, channel: supply_pressure, at: 30 bar, within: 0.5 bar}\n"
    hold: HoldFields

    def build(self, context: Context) -> Leaf:
        """Return a `Hold`."""
        fields = self.hold
        channel = context.channel(fields.channel, "hold", "channel")
        at = context.optional_si(fields.at, "hold", "at", unit=channel.unit, difference=channel.difference)
        if at is not None:
            with context.located("hold", "at"):
                check_set_point(context.rig, fields.channel, at)
        within = context.si(fields.within, "hold", "within", unit=channel.unit)
        action = Hold(context.si(fields.for_, "hold", "for"), fields.channel, at, within)
        around = f"at {show(at, channel.unit, difference=channel.difference)} " if at is not None else ""
        label = (
            f"hold {fields.channel} {around}± {show(within, channel.unit, difference=True)} "
            f"for {shown_time(action.duration)}"
        )
        return context.leaf(label, action)


@dataclass(frozen=True, slots=True)
class Hold(Action):
    """Monitor `channel` for `duration`; the step fails at the first sample outside `at` ± `within`."""

    duration: float  #: s
    channel: str
    at: float | None  #: SI; None: the reading at the start of the step
    within: float  #: SI, half width of the tolerance

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast the given duration."""
        reaches: Extents = {}
        if self.at is not None:
            reaches = {self.channel: (self.at - self.within, self.at + self.within)}
        return Forecast(self.duration, Basis.TIMED, bench.pass_time(state, self.duration), reaches)

    def set_point(self) -> SetPoint:
        """Return the channel and the value that is held."""
        return SetPoint(self.channel, self.at, self.within)

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Let `duration` s pass while the channel stays within tolerance.

        A reading outside the physical range of the channel contains no information on the measured quantity:
        it is left to the interlock, whose message names the sensor.

        Raises
        ------
        StepFailed
            a sample was outside the tolerance.
        """
        column = bench.columns[self.channel]
        begin = bench.now
        possible = bench.rig.channels[self.channel].possible
        row = yield from bench.fresh()
        # The reading at the start is the centre of the tolerance: it must be one.
        while not possible(row[column]):
            sample = yield Until(when=lambda sample: possible(sample[column]))
            row = row if sample is None else sample
        at = row[column] if self.at is None else self.at
        low, high = at - self.within, at + self.within

        def left(sample: Row) -> bool:
            return possible(sample[column]) and not low <= sample[column] <= high

        outside = row if left(row) else (yield Until(begin + self.duration, left))
        if outside is None:
            return Outcome.COMPLETE
        tolerance = reading(bench, self.channel, self.within, difference=True)
        raise StepFailed(
            f"{self.channel} left {reading(bench, self.channel, at)} ± {tolerance} after "
            f"{max(outside[0] - begin, 0.0):.3g} s: it was {reading(bench, self.channel, outside[column])}"
        )
