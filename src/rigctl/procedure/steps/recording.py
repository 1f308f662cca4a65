"""`record` and `measure`: keep what happens, and take values from what was kept."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal
from rigctl.procedure.actions import Measure, Missed, Stretch
from rigctl.procedure.context import Context
from rigctl.procedure.fields import Name, UnitName
from rigctl.procedure.measures import read_measure
from rigctl.procedure.plan import Leaf, Node, RecordNode
from rigctl.procedure.steps.base import Block, Part, Step
from rigctl.procedure.values import RATE, AnyValue, Count, Duration, Rate
from rigctl.units import show


class RecordFields(Part):
    """What is kept: one row for each sample, at `rate`."""

    name: Name = Field(description="what records of this kind are called")
    rate: Rate = Field(default=RATE.read("100 Hz"), description="samples per second")
    channels: Literal["all"] | list[str] = Field(default="all", description="all, or a list of channels")
    retries: Count | None = Field(
        default=None, description="how often it is repeated when the bench was lost inside it; 0 by default"
    )


class RecordStep(Block):
    """Record what the steps inside do: one record, the unit of fitting and of hold-out."""

    verb: ClassVar[str] = "record"
    example: ClassVar[str] = (
        "- record: {name: stroke, rate: 100 Hz, channels: all}\n"
        "  do:\n"
        "    - wait: 0.2 s\n"
        "    - extend: 1.05 s\n"
        "  finally:\n"
        "    - retract: {until: position < 1 mm}\n"
    )
    record: RecordFields

    def build(self, context: Context) -> Node:
        """A `RecordNode` that carries the values of the sweeps around it."""
        fields = self.record
        channels = self._channels(context)
        rate = context.si(fields.rate, "record", "rate")
        if context.recording:
            with context.located("record"):
                raise RigctlError("a record inside a record", value=fields.name)
        node = RecordNode(
            path=context.path,
            label=f"record '{fields.name}' at {show(rate, 'Hz')}",
            where=context.where(),
            name=fields.name,
            rate=rate,
            channels=channels,
            sweep=context.sweep_values(),
            body=context.inside_record().body(self.do, "do"),
            retries=int(context.optional_si(fields.retries, "record", "retries") or 0),
        )
        return context.with_cleanup(node, self)

    def _channels(self, context: Context) -> tuple[str, ...]:
        wanted = self.record.channels
        if wanted == "all":
            return context.rig.layout.channels
        for index, name in enumerate(wanted):
            context.channel(name, "record", "channels", index)
        if not wanted:
            with context.located("record", "channels"):
                raise RigctlError("no channel is recorded", expected="all, or at least one channel")
        return tuple(dict.fromkeys(wanted))


class MeasureFields(Part):
    """A value from recorded data, with limits that it passes or misses."""

    name: Name = Field(description="what the value is called")
    value: str = Field(
        min_length=1,
        description="an expression over statistics of channels: first, last, min, max, mean, std; duration",
        examples=["max(position) - min(position)", "mean(supply_pressure)"],
    )
    unit: UnitName = Field(description="the value's unit")
    low: AnyValue | None = Field(default=None, description="smallest value that passes")
    high: AnyValue | None = Field(default=None, description="largest value that passes")
    over: Literal["record", "phase"] | None = Field(
        default=None, description="the whole record (default), or since the last change of a command"
    )
    last: Duration | None = Field(default=None, description="instead of `over`: the last seconds")
    missed: Literal["fail", "continue"] = Field(
        default="fail", description="what follows when the value lies outside its limits"
    )

    @model_validator(mode="after")
    def _one_stretch(self) -> Self:
        if self.over is not None and self.last is not None:
            raise refusal(
                RigctlError("two stretches of samples", expected="either 'over' or 'last'"), ("last",)
            )
        return self


class MeasureStep(Step):
    """Take a value from the samples so far."""

    verb: ClassVar[str] = "measure"
    example: ClassVar[str] = (
        "- measure: {name: zero, value: mean(position), unit: mm, last: 2 s, low: -1 mm, high: 1 mm}\n"
    )
    measure: MeasureFields

    def build(self, context: Context) -> Leaf:
        """A `Measure` whose expression has the dimension of its unit."""
        fields = self.measure
        with context.located("measure", "value"):
            found = read_measure(
                fields.value, fields.unit, context.types(), context.answers, context.variables
            )
        interval = found.difference
        low = context.optional_si(fields.low, "measure", "low", unit=fields.unit, difference=interval)
        high = context.optional_si(fields.high, "measure", "high", unit=fields.unit, difference=interval)
        context.check_bounds(low, high, fields.unit, "measure", difference=interval)
        context.learn(fields.name, fields.unit, "measure", "name", difference=interval)
        action = Measure(
            name=fields.name,
            expression=found.expression,
            statistics=found.statistics,
            unit=fields.unit,
            stretch=self._stretch(context, needed=bool(found.statistics)),
            window=context.optional_si(fields.last, "measure", "last"),
            low=low,
            high=high,
            missed=Missed(fields.missed),
            difference=interval,
        )
        return context.leaf(f"measure {fields.name} = {fields.value}{_limits(action)}", action)

    def _stretch(self, context: Context, *, needed: bool) -> Stretch:
        fields = self.measure
        if fields.last is not None:
            return Stretch.WINDOW
        if fields.over == "phase":
            return Stretch.PHASE
        if needed and not context.recording:
            with context.located("measure"):
                raise RigctlError(
                    "no record is open here",
                    value=fields.name,
                    expected="'last: 2 s' or 'over: phase', or a place inside a record",
                )
        return Stretch.RECORD


def _limits(action: Measure) -> str:
    def bound(value: float) -> str:
        return show(value, action.unit, difference=action.difference)

    if action.low is not None and action.high is not None:
        return f", {bound(action.low)} to {bound(action.high)}"
    if action.low is not None:
        return f", at least {bound(action.low)}"
    return f", at most {bound(action.high)}" if action.high is not None else ""
