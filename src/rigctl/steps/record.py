"""`record`: record samples while the enclosed steps are executed."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from rigctl.errors import RigctlError
from rigctl.plan.context import Context
from rigctl.plan.fields import Name, ProcedurePart
from rigctl.plan.step import Block
from rigctl.plan.tree import Node, RecordNode
from rigctl.plan.values import RATE, SHARE, Count, Rate, Share
from rigctl.units import show


class RecordFields(ProcedurePart):
    """One row is stored for each sample, at `rate`."""

    name: Name = Field(description="name of records of this kind")
    rate: Rate = Field(default=RATE.read("100 Hz"), description="samples per second")
    channels: Literal["all"] | list[str] = Field(default="all", description="all, or a list of channels")
    retries: Count | None = Field(
        default=None, description="maximum number of repetitions if the bench is lost during it; 0 by default"
    )
    most_missing: Share = Field(
        default=SHARE.read("5 %"),
        description="share of its samples, or of the readings of a channel, that may be missing; with more "
        "the record is lost, and repeated if `retries` allows",
    )


class RecordStep(Block):
    """Record the samples during the enclosed steps as one record, the unit of fitting and of hold-out."""

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
        """Return a `RecordNode` with the values of the enclosing sweeps."""
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
            body=context.inside_record(rate).body(self.do, "do"),
            retries=int(context.optional_si(fields.retries, "record", "retries") or 0),
            most_missing=context.si(fields.most_missing, "record", "most_missing"),
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
