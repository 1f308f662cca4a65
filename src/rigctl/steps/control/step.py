"""The step `control`: its fields, checked against the rig.

In: the fields in a procedure. Out: a `Control` action with gains, bounds and formula in SI, or a
`ControlOnBoard` where the board is to compute; `_Builder` reads one group of fields after the other. The
controller itself is in `pid`, and what the step does during a run in `action` and `on_board`.

The gains are checked here, before anything moves: their signs must agree, their units follow from the
actuator's and the channel's (K for a temperature in degC), and the rate must be one that actuator and
record allow. `where: auto` leaves the choice to the bench, since a plan does not know whether its board
has a loop.
"""

from __future__ import annotations

import math
from dataclasses import fields as fields_of
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from rigctl.cadence import EARLY
from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal
from rigctl.plan.context import Context
from rigctl.plan.fields import Name, ProcedurePart
from rigctl.plan.setpoints import check_level, check_set_point
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.value_text import shown_time
from rigctl.plan.values import RATE, AnyDifference, AnyRate, AnyTolerance, AnyValue, Duration, Rate
from rigctl.project import find_project
from rigctl.rig import Actuator, Channel
from rigctl.steps.control.action import KEPT, Control
from rigctl.steps.control.feed_forward import FeedForward, read_feed_forward
from rigctl.steps.control.on_board import ControlOnBoard, whole_period
from rigctl.steps.control.pid import AntiWindup, Bounds, Gains
from rigctl.units import show

#: default amplitude, as a fraction of the channel's range, from which a sustained oscillation ends the step
_OSCILLATION = 0.02


class ControlFields(ProcedurePart):
    """A PID controller in parallel form with feed-forward; on the host sample by sample, or on the board."""

    actuator: str = Field(description="the actuator to command: a driven level")
    channel: str = Field(description="the channel to control")
    to: AnyValue = Field(description="the set-point")
    ramp: AnyRate | None = Field(
        default=None,
        description="rate at which the set-point moves there from the first reading; by default at once",
        examples=["2 K/min"],
    )
    gain: AnyDifference = Field(
        description="K_p, in units of the actuator per unit of the channel", examples=["4 %/K"]
    )
    integral: AnyDifference | None = Field(
        default=None,
        description="K_i, in units of the actuator per unit of the channel and second",
        examples=["0.05 %/(K*s)"],
    )
    derivative: AnyDifference | None = Field(
        default=None,
        description="K_d, on the reading, in units of the actuator times seconds per unit of the channel",
        examples=["20 %*s/K"],
    )
    derivative_filter: Duration | None = Field(
        default=None, description="T_f, the filter's time constant; by default a tenth of K_d/K_p"
    )
    anti_windup: Literal["back_calculation", "clamping"] = Field(
        default="back_calculation",
        description="method that limits the integral while the output is saturated",
    )
    tracking_time: Duration | None = Field(
        default=None, description="T_t of back-calculation; by default K_p/K_i"
    )
    feed_forward: str | None = Field(
        default=None,
        min_length=1,
        description="a formula of `setpoint`, channels, constants of the rig and parameters of a model",
        examples=["convection*(setpoint - ambient_temperature)/heater_gain_1"],
    )
    parameters_of: str | None = Field(
        default=None, description="the model file whose fitted parameters the formula can use"
    )
    start: Literal["bumpless", "zero"] = Field(
        default="bumpless", description="initial value of the integral: for a continuous output, or zero"
    )
    where: Literal["host", "board", "auto"] = Field(
        default="host",
        description="what computes the output: the host, the board (in a period of whole milliseconds), or "
        "the board if it can",
    )
    rate: Rate = Field(
        default=RATE.read("10 Hz"),
        description="updates per second; inside a record not above its rate, unless the board computes",
    )
    low: AnyValue | None = Field(default=None, description="minimum output; by default that of the actuator")
    high: AnyValue | None = Field(default=None, description="maximum output; by default that of the actuator")
    max_rate: AnyRate | None = Field(
        default=None, description="fastest change of the output; by default that of the actuator"
    )
    for_: Duration | None = Field(default=None, alias="for", description="duration, whatever the reading")
    within: AnyTolerance | None = Field(
        default=None, description="instead of `for`: until the reading has settled within this tolerance"
    )
    settle: Duration | None = Field(
        default=None, description="time for which it must stay within the tolerance"
    )
    timeout: Duration | None = Field(
        default=None, description="time after which the step fails if it has not settled"
    )
    oscillation: AnyTolerance | None = Field(
        default=None,
        description="amplitude above which a sustained oscillation ends the step; by default 2 % of "
        "the range",
    )
    name: Name = Field(default="control", description="prefix for the names of its measures")
    then: Literal["safe", "stay"] = Field(
        default="safe", description="at the end the output goes to its safe value, or keeps its last one"
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        settled = (self.within, self.settle, self.timeout)
        if (self.for_ is None) == (self.within is None):
            raise refusal(RigctlError("the loop has no end", expected="either 'for' or 'within'"))
        if any(part is None for part in settled) and any(part is not None for part in settled):
            raise refusal(
                RigctlError("settling needs all three", expected="'within', 'settle' and 'timeout'")
            )
        if self.parameters_of is not None and self.feed_forward is None:
            raise refusal(
                RigctlError("parameters without a formula", expected="'feed_forward'"), ("parameters_of",)
            )
        return self


class ControlStep(Step):
    """Control a channel with an actuator in a closed loop."""

    verb: ClassVar[str] = "control"
    example_rig: ClassVar[str] = "heater-board.yaml"
    example: ClassVar[str] = (
        "- control: {actuator: heater_1, channel: temperature_1, to: 50 degC, ramp: 10 K/min, gain: 4 %/K,\n"
        "    integral: 0.05 %/(K*s), rate: 1 Hz, within: 0.5 K, settle: 1 min, timeout: 20 min, then: stay}\n"
    )
    control: ControlFields

    def build(self, context: Context) -> Leaf:
        """Return a `Control` whose gains, bounds and formula have been checked against the rig."""
        return _Builder(context, self.control).leaf()


class _Builder:
    """Reads the fields of the step."""

    def __init__(self, context: Context, fields: ControlFields) -> None:
        self._context, self._fields = context, fields
        self._channel: Channel = context.channel(fields.channel, "control", "channel")
        self._actuator = self._driven_level()
        unit = self._channel.unit
        absolute = context.rig.layout.types()[fields.channel].temperature is not None
        self._interval = "K" if absolute else unit

    def leaf(self) -> Leaf:
        """Return the node of the plan."""
        context, fields = self._context, self._fields
        channel = self._channel
        to = context.si(fields.to, "control", "to", unit=channel.unit, difference=channel.difference)
        with context.located("control", "to"):
            check_set_point(context.rig, fields.channel, to)
        period = 1.0 / context.si(fields.rate, "control", "rate")
        self._check_period(period)
        action = Control(
            actuator=fields.actuator,
            channel=fields.channel,
            to=to,
            ramp=self._ramp(),
            gains=self._gains(),
            bounds=self._bounds(),
            feed_forward=self._feed_forward(),
            bumpless=fields.start == "bumpless",
            period=period,
            duration=context.optional_si(fields.for_, "control", "for"),
            within=context.optional_si(fields.within, "control", "within", unit=self._channel.unit),
            settle=context.optional_si(fields.settle, "control", "settle"),
            timeout=context.optional_si(fields.timeout, "control", "timeout"),
            oscillation=self._oscillation(),
            name=fields.name,
            stay=fields.then == "stay",
        )
        if fields.where != "host":
            given = {one.name: getattr(action, one.name) for one in fields_of(action)}
            action = ControlOnBoard(**given, required=fields.where == "board")
        for name, unit in KEPT.items():
            context.learn(f"{fields.name}_{name}", unit, "control", "name")
        shown = show(to, channel.unit, difference=channel.difference)
        return context.leaf(
            f"control {fields.channel} to {shown} by {fields.actuator} for {shown_time(action.longest)}",
            action,
        )

    def _driven_level(self) -> Actuator:
        name, keys = self._fields.actuator, ("control", "actuator")
        actuator = self._context.driven(name, *keys)
        with self._context.located(*keys):
            if actuator.kind != "level":
                raise RigctlError("this actuator has positions only", value=name, expected="a level")
        return actuator

    def _check_period(self, period: float) -> None:
        rest, around = self._actuator.min_interval, self._context.record_rate
        with self._context.located("control", "rate"):
            if period < rest * (1.0 - EARLY):
                raise RigctlError(
                    f"faster than '{self._fields.actuator}' may be commanded",
                    value=f"{1.0 / period:g} Hz",
                    expected=f"at most {1.0 / rest:g} Hz",
                )
            if self._fields.where == "board":
                whole_period(period)
            elif around is not None and 1.0 / period > around * (1.0 + EARLY):
                raise RigctlError(
                    "faster than the record's samples",
                    value=f"{1.0 / period:g} Hz",
                    expected=f"{around:g} Hz",
                )

    def _per(self, value: AnyDifference | None, field: str, more: str = "") -> float:
        """Return a gain in SI, actuator unit per channel unit, with the factor `more`; zero if omitted."""
        if value is None:
            return 0.0
        unit = f"({self._actuator.display_unit})/({self._interval}){more}"
        return self._context.si(value, "control", field, unit=unit)

    def _gains(self) -> Gains:
        fields, context = self._fields, self._context
        proportional = self._per(fields.gain, "gain")
        integral = self._per(fields.integral, "integral", "/s")
        derivative = self._per(fields.derivative, "derivative", "*s")
        for field, gain in (("integral", integral), ("derivative", derivative)):
            if gain * proportional < 0.0:
                with context.located("control", field):
                    raise RigctlError("acts against the gain", expected="the sign of 'gain'")
        filter_time = context.optional_si(fields.derivative_filter, "control", "derivative_filter")
        tracking = context.optional_si(fields.tracking_time, "control", "tracking_time")
        if proportional == 0.0 and (
            (derivative != 0.0 and filter_time is None) or (integral != 0.0 and tracking is None)
        ):
            with context.located("control", "gain"):
                raise RigctlError(
                    "without a gain", expected="'tracking_time' and 'derivative_filter' as well"
                )
        return Gains(
            proportional=proportional,
            integral=integral,
            derivative=derivative,
            filter_time=filter_time or (0.1 * derivative / proportional if proportional else 0.0),
            tracking_time=tracking or (proportional / integral if integral else math.inf),
            anti_windup=AntiWindup(fields.anti_windup),
        )

    def _bounds(self) -> Bounds:
        fields, context, described = self._fields, self._context, self._actuator
        unit = described.display_unit
        ends = []
        for field, own in (("low", described.low), ("high", described.high)):
            given = context.optional_si(getattr(fields, field), "control", field, unit=unit)
            with context.located("control", field):
                if given is None and own is None:
                    raise RigctlError(f"'{fields.actuator}' has no '{field}'", expected=f"'{field}' here")
                ends.append(float(own or 0.0) if given is None else given)
                check_level(context.rig, fields.actuator, ends[-1])
        context.check_bounds(ends[0], ends[1], unit, "control")
        rate = context.optional_si(fields.max_rate, "control", "max_rate", unit=f"({unit})/s")
        fastest = float(described.max_rate) if described.max_rate is not None else math.inf
        if rate is not None and not 0.0 < rate <= fastest:
            with context.located("control", "max_rate"):
                raise RigctlError(
                    "a rate that the actuator does not allow",
                    value=show(rate, f"{unit}/s", difference=True),
                    expected="more than 0, and not above the actuator's own",
                )
        return Bounds(ends[0], ends[1], fastest if rate is None else rate)

    def _ramp(self) -> float | None:
        rate = self._context.optional_si(self._fields.ramp, "control", "ramp", unit=f"({self._interval})/s")
        if rate is not None and not rate > 0.0:
            with self._context.located("control", "ramp"):
                raise RigctlError("the set-point would never be reached", expected="more than 0")
        return rate

    def _feed_forward(self) -> FeedForward | None:
        fields, context = self._fields, self._context
        if fields.feed_forward is None:
            return None
        model = None
        if fields.parameters_of is not None:
            with context.located("control", "parameters_of"):
                path = context.document.path
                project = find_project(path.parent if path else None)
                model = project.resolve(fields.parameters_of, relative_to=path)
        with context.located("control", "feed_forward"):
            return read_feed_forward(
                context,
                fields.feed_forward,
                model,
                self._channel.unit,
                self._actuator.display_unit,
                difference=self._channel.difference,
            )

    def _oscillation(self) -> float:
        given = self._context.optional_si(
            self._fields.oscillation, "control", "oscillation", unit=self._channel.unit
        )
        if given is not None:
            return given
        possible = self._channel.range
        return _OSCILLATION * float(possible[1] - possible[0]) if possible is not None else math.inf
