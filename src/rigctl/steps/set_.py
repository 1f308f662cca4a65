"""`set`: command actuators directly.

In: names and values, and perhaps a time. Out: all of them commanded at once, each acknowledged; with a
time, all are back at their safe values at the end. What a person turns is asked for, what may not jump is
brought there slowly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field, WithJsonSchema

from rigctl.errors import RigctlError, unknown_name
from rigctl.plan.action import Action
from rigctl.plan.behaviour import Behaviour, OnPause, Question, StepBench, Until
from rigctl.plan.context import Context
from rigctl.plan.fields import ProcedurePart
from rigctl.plan.forecast import Basis, Forecast, ForecastBench, State
from rigctl.plan.outcomes import Outcome
from rigctl.plan.setpoints import check_level
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.value_text import shown_time
from rigctl.plan.values import MARK, OPEN, Duration
from rigctl.rig import Actuator, Rig
from rigctl.steps.approach import approach, approach_time


def _truth_to_word(written: Any) -> Any:
    # YAML 1.2 reads `true` as a boolean, and users write it for a switch
    return {True: "on", False: "off"}[written] if isinstance(written, bool) else written


#: the name of a switching position, a number, or a quantity, depending on the actuator
Command = Annotated[
    str | int | float,
    BeforeValidator(_truth_to_word),
    WithJsonSchema({"type": ["string", "number", "boolean"], "examples": ["on", "extend", "30 bar"]}),
]


def _lengthen(written: Any) -> Any:
    return written if isinstance(written, dict) and "values" in written else {"values": written}


class SetFields(ProcedurePart):
    """The full form returns the actuators to their safe values after a time."""

    values: dict[str, Command] = Field(min_length=1, description="actuator: value")
    for_: Duration | None = Field(
        default=None, alias="for", description="time after which they return to their safe values"
    )


class SetStep(Step):
    """Command one or more actuators: ``set: {heater: on}``."""

    verb: ClassVar[str] = "set"
    example: ClassVar[str] = (
        "- set: {heater: on, valve: neutral}\n- set: {values: {valve: extend}, for: 500 ms}\n"
    )
    set: Annotated[
        SetFields,
        BeforeValidator(_lengthen, json_schema_input_type=SetFields | dict[str, Command]),
    ]

    def build(self, context: Context) -> Leaf:
        """Return a `Set` whose values have been checked against the actuators' ranges."""
        fields = self.set
        actuators = context.rig.actuators
        values: dict[str, float] = {}
        for name, command in fields.values.items():
            with context.located("set", "values", name):
                if name not in actuators:
                    raise unknown_name("actuator", name, actuators)
                values[name] = read_command(context, name, actuators[name], command)
        duration = context.optional_si(fields.for_, "set", "for")
        if duration is not None:
            for name in values:
                with context.located("set", "values", name):
                    if name not in context.rig.safe_state:
                        raise RigctlError("this actuator has no safe value to return to", value=name)
                    if actuators[name].max_rate is not None:
                        raise RigctlError(
                            "this actuator may not jump, as its max_rate says, and cannot be set for a time",
                            value=name,
                            expected="'set' without 'for', or a 'waveform'",
                        )
                    if actuators[name].by == "operator":
                        # the others would stay on until the operator answers, and nobody would reset this one
                        raise RigctlError(
                            "this actuator is turned by hand, and cannot be set for a time",
                            value=name,
                            expected="a driven one, or 'set' without 'for'",
                        )
        shown = ", ".join(f"{name} {actuators[name].show(value)}" for name, value in values.items())
        label = f"set {shown}" + (f" for {shown_time(duration)}" if duration else "")
        return context.leaf(label, Set(values, duration))


def read_command(context: Context, name: str, actuator: Actuator, command: str | float) -> float:
    """Return the SI value of a command written in a file.

    Raises
    ------
    RigctlError
        the command is not one of the actuator's positions, has a wrong unit, or is out of range.
    """
    if isinstance(command, str) and MARK in command:
        value = OPEN.read(command).si(context.variables, actuator.display_unit)
    else:
        value = actuator.read(command)
    check_level(context.rig, name, value)
    return value


@dataclass(frozen=True, slots=True)
class Set(Action):
    """Command actuators by name, all at once; with `duration`, each then returns to its safe value."""

    values: Mapping[str, float]
    duration: float | None = None  #: s

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast the given duration, or no time without one."""
        role = bench.rig.roles.set_pressure
        before = {name: state.levels.get(name, bench.rig.safe_state.get(name, 0.0)) for name in self.values}
        approach = max(
            approach_time(before[name], value, bench.rig.actuators[name].max_rate)
            for name, value in self.values.items()
        )
        seconds = self.duration or approach
        after = bench.pass_time(state, seconds)
        if self.duration is None:
            after = replace(after, levels={**state.levels, **self.values})
        basis = Basis.ESTIMATED if approach else Basis.TIMED
        if role is None or role.actuator not in self.values:
            return Forecast(seconds, basis, after)
        level = self.values[role.actuator]
        return Forecast(seconds, basis, replace(after, pressure=level), {role.channel: (level, level)})

    def questions(self, rig: Rig) -> tuple[Question, ...]:
        """Return a request for each actuator that is operated by hand."""
        return tuple(
            _request(rig, name, value)
            for name, value in self.values.items()
            if rig.actuators[name].by == "operator"
        )

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Command every actuator; with a duration, wait until they have returned to their safe values.

        A driven level with a ``max_rate`` is brought there at this rate, after the others were commanded.

        For an actuator that is operated by hand the operator is asked, and has to confirm; such an actuator
        is never set for a limited time.
        """
        ends: dict[str, float] = {}
        if self.duration is not None:  # all must start together, so none may be delayed by its resting time
            while bench.now < (ready := max(bench.rested_at(*each) for each in self.values.items())):
                yield Until(ready)
        # The others first: those that may jump are all commanded at once, and none waits for a level that
        # takes minutes.
        gradual = {
            name: value
            for name, value in self.values.items()
            if bench.rig.actuators[name].by == "driven" and bench.rig.actuators[name].max_rate is not None
        }
        for name, value in self.values.items():
            if name in gradual:
                continue
            receipt = yield from bench.command(name, value, self.duration)
            ends[name] = receipt.time + (self.duration or 0.0)
            if bench.rig.actuators[name].by == "operator":
                yield from bench.ask(_request(bench.rig, name, value))
        yield from approach(bench, gradual)
        if self.duration is not None:
            # In the order in which they end, so that a host that ends them is late for none.
            for name in sorted(ends, key=lambda name: ends[name]):
                yield Until(ends[name], on_pause=OnPause.DEFER)
                yield from bench.finish_pulse(name)
        return Outcome.COMPLETE

    def lasting(self) -> frozenset[str]:
        """Return the actuators, unless they return to their safe values."""
        return frozenset(self.values) if self.duration is None else frozenset()


def _request(rig: Rig, name: str, value: float) -> Question:
    """Return the request to set an actuator by hand, which has to be confirmed."""
    return Question(f"Set {name} to {rig.actuators[name].show(value)}")
