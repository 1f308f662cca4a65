"""`prompt`: ask the operator, and store the answer as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal
from rigctl.plan.action import Action
from rigctl.plan.behaviour import Behaviour, Question, StepBench
from rigctl.plan.context import Context
from rigctl.plan.fields import Name, ProcedurePart, Short, UnitName
from rigctl.plan.forecast import Basis, Forecast, ForecastBench, State
from rigctl.plan.measured import MeasuredValue
from rigctl.plan.outcomes import Outcome
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.values import AnyValue
from rigctl.rig import Rig
from rigctl.units import show

#: s assumed for a person to confirm, and to type a value
_ANSWERING = 10.0
_TYPING = 20.0


class PromptFields(ProcedurePart):
    """Without a `name`, a confirmation is enough; with one, a value is entered with its unit and stored."""

    question: str = Field(
        min_length=1,
        max_length=500,
        description="the text for the operator; $names are replaced by their values",
    )
    name: Name | None = Field(default=None, description="name of the answer")
    unit: UnitName | None = Field(default=None, description="unit of the answer; 1 for a plain number")
    low: AnyValue | None = Field(default=None, description="smallest valid answer")
    high: AnyValue | None = Field(default=None, description="largest valid answer")
    simulated: AnyValue | None = Field(default=None, description="the answer of a simulated operator")

    @model_validator(mode="after")
    def _named(self) -> Self:
        if self.name is not None and self.unit is None:
            raise refusal(RigctlError("a typed answer needs a unit", expected="e.g. 'unit: s'"))
        if self.name is None:
            for field in ("unit", "low", "high", "simulated"):
                if getattr(self, field) is not None:
                    raise refusal(RigctlError("only a named answer has this", expected="a 'name'"), (field,))
        return self


class PromptStep(Step):
    """Ask the operator; the run waits for the answer."""

    verb: ClassVar[str] = "prompt"
    example: ClassVar[str] = (
        "- prompt: Close the door.\n"
        "- prompt: {question: How long did it take?, name: run_time, unit: s, low: 10 s, high: 1 h}\n"
    )
    prompt: Annotated[PromptFields, Short("question")]

    def build(self, context: Context) -> Leaf:
        """Return a `Prompt` whose bounds have been checked against its unit."""
        fields = self.prompt
        question = context.fill_in(fields.question, "prompt", "question")
        if fields.name is None or fields.unit is None:
            return context.leaf(f"ask: {question}", Prompt(question))
        low = context.optional_si(fields.low, "prompt", "low", unit=fields.unit)
        high = context.optional_si(fields.high, "prompt", "high", unit=fields.unit)
        simulated = context.optional_si(fields.simulated, "prompt", "simulated", unit=fields.unit)
        with context.located("prompt", "simulated"):
            below = low is not None and simulated is not None and simulated < low
            above = high is not None and simulated is not None and simulated > high
            if simulated is not None and (below or above):
                raise RigctlError("outside the bounds of the answer", value=show(simulated, fields.unit))
        context.check_bounds(low, high, fields.unit, "prompt")
        context.learn(fields.name, fields.unit, "prompt", "name")
        action = Prompt(question, fields.name, fields.unit, low, high, simulated)
        return context.leaf(f"ask {fields.name} [{fields.unit}]: {question}", action)


@dataclass(frozen=True, slots=True)
class Prompt(Action):
    """Ask the operator for a confirmation or, with a name, for a value, which is stored as data."""

    question: str
    name: str | None = None
    unit: str | None = None  #: unit in which the answer is typed and shown
    low: float | None = None  #: SI, inclusive
    high: float | None = None  #: SI, inclusive
    simulated: float | None = None  #: SI; answer of a simulated operator

    @property
    def _asked(self) -> Question:
        """The question as it is put to the operator."""
        return Question(
            text=self.question,
            name=self.name,
            unit=self.unit,
            low=self.low,
            high=self.high,
            simulated=self.simulated,
        )

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast the time that is assumed for an operator's answer."""
        seconds = bench.operator_time(_ANSWERING if self.name is None else _TYPING)
        basis = Basis.ESTIMATED if bench.simulated else Basis.GUESSED
        return Forecast(seconds, basis, bench.pass_time(state, seconds))

    def questions(self, rig: Rig) -> tuple[Question, ...]:
        """Return the question."""
        return (self._asked,)

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Wait for a confirmation or a value; sampling and interlocks continue meanwhile."""
        answer = yield from bench.ask(self._asked)
        if self.name is not None and answer.value is not None:
            answered = MeasuredValue(
                self.name, answer.value, self.unit or "1", self.low, self.high, typed=True
            )
            bench.record_measure(answered)
        return Outcome.COMPLETE
