"""`wait`: let time pass, or wait for a condition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError
from rigctl.expressions import Expression
from rigctl.files.refusal import refusal
from rigctl.plan.action import Action
from rigctl.plan.behaviour import Behaviour, StepBench, Until
from rigctl.plan.context import Context
from rigctl.plan.fields import Condition, ProcedurePart, Short
from rigctl.plan.forecast import Basis, Forecast, ForecastBench, State
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.value_text import shown_time
from rigctl.plan.values import Duration, Period
from rigctl.steps.readings import seen


class WaitFields(ProcedurePart):
    """Either `for`, or `until` with a `timeout`."""

    for_: Period | None = Field(default=None, alias="for", description="how long")
    until: Condition | None = Field(default=None, description="a condition, e.g. oil_temperature < 40 degC")
    timeout: Duration | None = Field(
        default=None, description="with `until`: time after which the step fails"
    )

    @model_validator(mode="after")
    def _one_end(self) -> Self:
        if (self.for_ is None) == (self.until is None):
            raise refusal(RigctlError("a wait needs exactly one end", expected="either 'for' or 'until'"))
        if (self.until is None) != (self.timeout is None):
            what = "'until' needs a timeout" if self.until else "a timeout goes with 'until'"
            raise refusal(RigctlError(what, expected="e.g. '{until: position < 1 mm, timeout: 10 s}'"))
        return self


class WaitStep(Step):
    """Wait; recording and interlocks continue."""

    verb: ClassVar[str] = "wait"
    example: ClassVar[str] = "- wait: 0.2 s\n- wait: {until: oil_temperature < 40 degC, timeout: 3 h}\n"
    wait: Annotated[WaitFields, Short("for")]

    def build(self, context: Context) -> Leaf:
        """Return a `Wait`."""
        fields = self.wait
        until = context.condition(fields.until, "wait", "until") if fields.until else None
        action = Wait(
            duration=context.optional_si(fields.for_, "wait", "for"),
            until=until,
            timeout=context.optional_si(fields.timeout, "wait", "timeout"),
        )
        label = f"wait until {until.text}" if until else f"wait {shown_time(action.duration or 0.0)}"
        return context.leaf(label, action)


@dataclass(frozen=True, slots=True)
class Wait(Action):
    """Let time pass: `duration` seconds, or until a condition holds, failing after `timeout`."""

    duration: float | None = None  #: s
    until: Expression | None = None
    timeout: float | None = None  #: s; given with `until`

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast the given duration; for a condition, its time-out."""
        if self.duration is not None:
            return Forecast(self.duration, Basis.TIMED, bench.pass_time(state, self.duration))
        seconds = self.timeout or 0.0
        return Forecast(seconds, Basis.AT_MOST, bench.pass_time(state, seconds))

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Wait `duration` s, or until the condition holds.

        Raises
        ------
        StepFailed
            the condition did not become true within `timeout` s.
        """
        if self.until is None:
            yield Until(bench.now + (self.duration or 0.0))
            return Outcome.COMPLETE
        # The time-out counts from here, also while a fresh reading is awaited.
        condition = bench.condition(self.until)
        timeout = self.timeout or 0.0
        give_up = bench.now + timeout
        # A condition that already holds ends the wait, but by a reading taken after the last command.
        row = yield from bench.fresh()
        if not condition(row) and (yield Until(give_up, condition)) is None:
            raise StepFailed(
                f"'{self.until.text}' did not come true within {timeout:g} s; "
                f"{seen(bench, self.until.names)}",
                outcome=Outcome.TIMED_OUT,
            )
        return Outcome.COMPLETE
