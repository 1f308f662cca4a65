"""`extend` and `retract`: move the cylinder for a time, until a condition holds, or to a position."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal
from rigctl.procedure.actions import Move
from rigctl.procedure.context import Context
from rigctl.procedure.fields import Condition, Short
from rigctl.procedure.plan import Leaf
from rigctl.procedure.setpoints import check_set_point
from rigctl.procedure.shown import shown_time
from rigctl.procedure.steps.base import Part, Step
from rigctl.procedure.values import (
    DURATION,
    LENGTH_TOLERANCE,
    Duration,
    Length,
    LengthTolerance,
)
from rigctl.units import show

_ENDS = ("for_", "until", "to")
_TIMEOUT = DURATION.read("10 s")
_WITHIN = LENGTH_TOLERANCE.read("1 mm")


class MoveFields(Part):
    """What ends the move: exactly one of `for`, `until` and `to`. The valve then closes."""

    for_: Duration | None = Field(
        default=None, alias="for", description="a time, kept by the board where it can keep it"
    )
    until: Condition | None = Field(default=None, description="a condition, e.g. position < 1 mm")
    to: Length | None = Field(default=None, description="a position, in closed loop")
    within: LengthTolerance | None = Field(default=None, description="with `to`; 1 mm by default")
    timeout: Duration | None = Field(default=None, description="with `until` and `to`; 10 s by default")

    @model_validator(mode="after")
    def _one_end(self) -> Self:
        given = [name.rstrip("_") for name in _ENDS if getattr(self, name) is not None]
        if len(given) != 1:
            what = "nothing ends this move" if not given else "more than one thing ends this move"
            raise refusal(
                RigctlError(what, value=" and ".join(given) or None, expected="one of for, until, to")
            )
        if self.timeout is not None and self.for_ is not None:
            raise refusal(RigctlError("a timeout goes with 'until' or 'to', not with 'for'"), ("timeout",))
        if self.within is not None and self.to is None:
            raise refusal(RigctlError("a tolerance goes with 'to'"), ("within",))
        return self


class _MoveStep(Step):
    verb: ClassVar[str]
    direction: ClassVar[Literal[1, -1]]

    def _fields(self) -> MoveFields:
        fields: MoveFields = getattr(self, self.verb)
        return fields

    def build(self, context: Context) -> Leaf:
        """A `Move` on the actuator of the rig's role."""
        role = context.move_role(self.verb)
        fields = self._fields()
        action = Move(
            direction=self.direction,
            actuator=role.actuator,
            value=context.rig.actuators[role.actuator].read(role.value.text),
            position=role.position,
            duration=context.optional_si(fields.for_, self.verb, "for"),
            until=context.condition(fields.until, self.verb, "until") if fields.until else None,
            target=self._target(context, role.position),
            within=context.si(fields.within or _WITHIN, self.verb, "within") if fields.to else None,
            timeout=None if fields.for_ else context.si(fields.timeout or _TIMEOUT, self.verb, "timeout"),
        )
        return context.leaf(self._label(context, action), action)

    def _target(self, context: Context, position: str | None) -> float | None:
        fields = self._fields()
        if fields.to is None:
            return None
        with context.located(self.verb, "to"):
            if position is None:
                raise RigctlError(
                    f"this rig does not say where the position of '{self.verb}' is read",
                    hint=f"Add 'position' to roles: {self.verb}: in the rig file",
                )
            target = context.si(fields.to, self.verb, "to")
            check_set_point(context.rig, position, target)
            stroke = context.rig.geometry.get("stroke")
            if stroke is not None and not 0.0 <= target <= stroke:
                unit = context.rig.channels[position].unit
                raise RigctlError(
                    "outside the stroke",
                    value=show(target, unit),
                    expected=f"{show(0.0, unit)} to {show(stroke, unit)}",
                )
        return target

    def _label(self, context: Context, action: Move) -> str:
        if action.duration is not None:
            return f"{self.verb} for {shown_time(action.duration)}"
        if action.until is not None:
            return f"{self.verb} until {action.until.text}"
        unit = context.rig.channels[action.position].unit if action.position else "mm"
        return f"{self.verb} to {show(action.target or 0.0, unit)} ± {show(action.within or 0.0, unit)}"


class ExtendStep(_MoveStep):
    """Move the rod out."""

    verb: ClassVar[str] = "extend"
    example: ClassVar[str] = (
        "- extend: 1.05 s                                   # by time\n"
        "- extend: {until: position > 80 mm, timeout: 5 s}  # until a condition holds\n"
        "- extend: {to: 100 mm, within: 1 mm}               # to a position, in closed loop\n"
    )
    direction: ClassVar[Literal[1, -1]] = 1
    extend: Annotated[MoveFields, Short("for")]


class RetractStep(_MoveStep):
    """Move the rod in."""

    verb: ClassVar[str] = "retract"
    example: ClassVar[str] = "- retract: {until: position < 1 mm, timeout: 10 s}\n"
    direction: ClassVar[Literal[1, -1]] = -1
    retract: Annotated[MoveFields, Short("for")]
