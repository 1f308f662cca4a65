"""`extend` and `retract`: move the cylinder for a time, until a condition holds, or to a position.

In: the fields in a procedure, with the rig's role for the direction. Out: a `Move` with its forecast,
which follows from the flow through the throttle, and its behaviour during a run.

The three ends differ in who watches the clock. A time is given to the bench with the command, which times
the pulse itself where it can: delays of the host then do not change the stroke. A condition is examined
at each sample, and a position is controlled in closed loop (`approach`). Whatever happens, the actuator
is at its safe value afterwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError
from rigctl.expressions import Expression
from rigctl.files.refusal import refusal
from rigctl.plan.action import Action, SetPoint
from rigctl.plan.behaviour import Behaviour, OnPause, StepBench, Until
from rigctl.plan.context import Context
from rigctl.plan.fields import Condition, ProcedurePart, Short
from rigctl.plan.forecast import Basis, Extents, Forecast, ForecastBench, State
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.plan.setpoints import check_set_point
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.value_text import shown_time
from rigctl.plan.values import DURATION, LENGTH_TOLERANCE, Duration, Length, LengthTolerance
from rigctl.steps.move_to_position import approach
from rigctl.steps.readings import seen
from rigctl.units import show

_ENDS = ("for_", "until", "to")
_TIMEOUT = DURATION.read("10 s")
_WITHIN = LENGTH_TOLERANCE.read("1 mm")
#: s for the valve, in addition to the motion
_VALVE = 0.1


class MoveFields(ProcedurePart):
    """The move is ended by exactly one of `for`, `until` and `to`; the valve then closes."""

    for_: Duration | None = Field(
        default=None, alias="for", description="a time, controlled by the board where possible"
    )
    until: Condition | None = Field(default=None, description="a condition, e.g. position < 1 mm")
    to: Length | None = Field(default=None, description="a position, reached in closed loop")
    within: LengthTolerance | None = Field(default=None, description="tolerance, with `to`; 1 mm by default")
    timeout: Duration | None = Field(
        default=None, description="after which the step fails, with `until` and `to`; 10 s by default"
    )

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
        """Return a `Move` with the actuator of the rig's role."""
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


@dataclass(frozen=True, slots=True)
class Move(Action):
    """Move the cylinder; exactly one of `duration`, `until` and `target` is given.

    A `duration` is timed by the bench if possible. A move with `until` ends at the first sample that
    satisfies the condition, and fails after `timeout`. A move to a `target` is controlled in closed loop: the
    position must come to rest within `within` of it. After every move the actuator is at its safe value.
    """

    direction: Literal[1, -1]  #: +1 extend, -1 retract
    actuator: str
    value: float  #: commanded value, SI
    position: str | None  #: the channel that measures the position, if the rig has one
    duration: float | None = None  #: s
    until: Expression | None = None
    target: float | None = None  #: m
    within: float | None = None  #: m, half width; given with `target`
    timeout: float | None = None  #: s; given with `until` and `target`

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast the given duration, or the distance divided by the speed that follows from the flow
        through the throttle."""
        speed = bench.speed(self.direction, state)
        if self.duration is not None:
            travel = self.direction * (speed or 0.0) * self.duration
            seconds, basis = self.duration, Basis.TIMED
        elif speed is None or speed <= 0.0:
            travel = 0.0
            seconds, basis = self.timeout or 0.0, Basis.AT_MOST
        else:
            travel = self._travel(state, bench.stroke or 0.0)
            seconds = min(abs(travel) / speed + _VALVE, self.timeout or math.inf)
            basis = Basis.ESTIMATED
        stroke = math.inf if bench.stroke is None else bench.stroke
        position = min(max(state.position + travel, 0.0), stroke)
        after = replace(bench.pass_time(state, seconds), position=position)
        reaches: Extents = {}
        if self.position is not None and speed is not None and 0.0 < position < stroke:
            # if it reaches an end stop it stops there anyway, which is not a position that the plan commands
            reaches = {self.position: (position, position)}
        return Forecast(seconds, basis, after, reaches)

    def _travel(self, state: State, stroke: float) -> float:
        """Return the distance to be travelled, m; a condition is assumed to hold at the end of the stroke."""
        if self.target is not None:
            way = self.target - state.position
            return way if way * self.direction > 0.0 else 0.0
        return stroke - state.position if self.direction > 0 else -state.position

    def set_point(self) -> SetPoint | None:
        """Return the position channel and its target for a move in closed loop, otherwise None."""
        if self.target is None or self.position is None:
            return None
        return SetPoint(self.position, self.target, self.within)

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Move; at the end the actuator is back at its safe value, whatever the outcome.

        Raises
        ------
        StepFailed
            the condition, or the position, was not reached in time.
        """
        if self.duration is not None:
            return self._for_a_time(bench, self.duration)
        if self.target is not None:
            return approach(self, bench)
        return self._until(bench)

    def _for_a_time(self, bench: StepBench, duration: float) -> Behaviour:
        """Move for a time, measured by the bench if possible, so that delays of the host do not matter."""
        # The end counts from when the bench has switched, not from when it was asked. DEFER: half a move has
        # no place to go on from.
        receipt = yield from bench.command(self.actuator, self.value, duration)
        yield Until(receipt.time + duration, on_pause=OnPause.DEFER)
        yield from bench.finish_pulse(self.actuator)
        return Outcome.COMPLETE

    def _until(self, bench: StepBench) -> Behaviour:
        if self.until is None:
            raise ValueError("a move without duration, condition and target")
        condition = bench.condition(self.until)
        row = yield from bench.fresh()
        if condition(row):
            return Outcome.COMPLETE
        timeout = self.timeout or 0.0
        yield from bench.command(self.actuator, self.value)
        try:
            reached = yield Until(bench.now + timeout, condition)
        finally:
            # Not if an ending has made it safe, or the bench has switched it by itself.
            if bench.commanded[self.actuator] == self.value:
                bench.release(self.actuator)
        if reached is None:
            names = self.until.names | ({self.position} if self.position else set())
            raise StepFailed(
                f"'{self.until.text}' was not reached within {timeout:g} s; {seen(bench, names)}",
                outcome=Outcome.TIMED_OUT,
            )
        return Outcome.COMPLETE
