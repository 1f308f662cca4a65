"""`measure`: a value from recorded data, compared with its limits.

In: an expression over statistics of channels (`max(position) - min(position)`), over a record, a phase or
the last seconds. Out: a value that is stored with its record, and can be used by later steps. Which
statistics are needed is known when the plan is made: the runner keeps in memory only the channels that
some measure names (`rigctl.runner.recent_samples`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from rigctl.errors import RigctlError, unknown_name
from rigctl.expressions import Expression, ValueType, parse, type_of_unit
from rigctl.files.refusal import refusal
from rigctl.plan.action import Action
from rigctl.plan.behaviour import CHECKPOINT, Behaviour, StepBench
from rigctl.plan.context import Context
from rigctl.plan.fields import Name, ProcedurePart, UnitName
from rigctl.plan.forecast import Basis, Forecast, ForecastBench, State
from rigctl.plan.measured import MeasuredValue
from rigctl.plan.missing import MOST_MISSING
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.plan.statistics import DURATION, STATISTICS, Statistic, Stretch, find_statistics
from rigctl.plan.step import Step
from rigctl.plan.tree import Leaf
from rigctl.plan.values import SHARE, AnyValue, Duration, Share, Variables, substituted
from rigctl.units import describe, parse_unit, show


class Missed(Enum):
    """The consequence of a measure outside its limits."""

    FAIL = "fail"  #: the step fails, and with it the record and the run
    CONTINUE = "continue"  #: it is recorded as missed; the run continues and ends with exit code 1


class MeasureFields(ProcedurePart):
    """A value from recorded data, with optional limits."""

    name: Name = Field(description="name of the value")
    value: str = Field(
        min_length=1,
        description="an expression over statistics of channels: first, last, min, max, mean, std; duration",
        examples=["max(position) - min(position)", "mean(supply_pressure)"],
    )
    unit: UnitName = Field(description="the value's unit")
    low: AnyValue | None = Field(default=None, description="lower limit")
    high: AnyValue | None = Field(default=None, description="upper limit")
    over: Literal["record", "phase"] | None = Field(
        default=None, description="the whole record (default), or since the last change of a command"
    )
    last: Duration | None = Field(
        default=None, description="instead of `over`: the time before now over which it is taken"
    )
    most_missing: Share = Field(
        default=SHARE.read("5 %"),
        description="share of the readings that may be missing or impossible; with more the value counts as "
        "outside its limits",
    )
    missed: Literal["fail", "continue"] = Field(
        default="fail", description="consequence if the value is outside its limits"
    )

    @model_validator(mode="after")
    def _one_stretch(self) -> Self:
        if self.over is not None and self.last is not None:
            raise refusal(
                RigctlError("two stretches of samples", expected="either 'over' or 'last'"), ("last",)
            )
        return self


class MeasureStep(Step):
    """Calculate a value from the samples so far."""

    verb: ClassVar[str] = "measure"
    example: ClassVar[str] = (
        "- measure: {name: zero, value: mean(position), unit: mm, last: 2 s, low: -1 mm, high: 1 mm}\n"
    )
    measure: MeasureFields

    def build(self, context: Context) -> Leaf:
        """Return a `Measure` whose expression has the dimension of its unit."""
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
            most_missing=context.si(fields.most_missing, "measure", "most_missing"),
            difference=interval,
        )
        return context.leaf(f"measure {fields.name} = {fields.value}{_after_comma(action.limits)}", action)

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


def _after_comma(text: str | None) -> str:
    return f", {text}" if text else ""


@dataclass(frozen=True, slots=True)
class Measure(Action):
    """A value from recorded data, compared with its limits, and stored with its record.

    `expression` names statistics by `Statistic.key`, and earlier measures and operators' answers by name;
    see `rigctl.plan.statistics`.
    """

    name: str
    expression: Expression
    statistics: tuple[Statistic, ...]
    unit: str
    stretch: Stretch
    window: float | None = None  #: s; given with Stretch.WINDOW
    low: float | None = None  #: SI, inclusive
    high: float | None = None  #: SI, inclusive
    missed: Missed = Missed.FAIL
    difference: bool = False  #: whether it is a temperature interval, shown without offset
    most_missing: float = MOST_MISSING  #: share of readings without a value above which it does not pass

    def passes(self, value: float) -> bool:
        """Return whether the value is within the limits; False for NaN."""
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        return low <= value <= high

    @property
    def limits(self) -> str | None:
        """The limits as text; None if there are none."""

        def shown(value: float) -> str:
            return show(value, self.unit, difference=self.difference)

        if self.low is not None and self.high is not None:
            return f"{shown(self.low)} to {shown(self.high)}"
        if self.low is not None:
            return f"at least {shown(self.low)}"
        return f"at most {shown(self.high)}" if self.high is not None else None

    def forecast(self, state: State, bench: ForecastBench) -> Forecast:
        """Forecast no time."""
        return Forecast(0.0, Basis.TIMED, state)

    def carry_out(self, bench: StepBench) -> Behaviour:
        """Compute the value, and store it with the open record or, without one, with the run.

        Raises
        ------
        StepFailed
            there is no value, or it is outside its limits, unless the procedure lets the run continue then.
        """
        yield CHECKPOINT
        value = float(self.expression.evaluate(bench.statistics(self.statistics, self.stretch, self.window)))
        lack = bench.lack(self.statistics, self.stretch, self.window)
        passed = self.passes(value) and not lack.exceeds(self.most_missing)
        unit, difference = self.unit, self.difference
        bench.record_measure(
            MeasuredValue(
                self.name,
                value,
                unit,
                self.low,
                self.high,
                passed,
                difference=difference,
                missing=lack.share,
            )
        )
        if passed:
            if lack.missing:
                bench.event("note", f"{self.name} was taken without {lack}")
            return Outcome.COMPLETE
        found = "has no value" if math.isnan(value) else f"is {show(value, unit, difference=difference)}"
        if self.passes(value):
            text = f"{self.name} {found} without {lack}, more than {100.0 * self.most_missing:.3g} %"
        else:
            text = f"{self.name} {found}, expected {self.limits or 'a number'}"
        if self.missed is Missed.FAIL:
            raise StepFailed(text, outcome=Outcome.MISSED)
        bench.event("note", text)
        bench.missed.append(text)
        return Outcome.MISSED


@dataclass(frozen=True, slots=True)
class ReadMeasure:
    """A parsed measure; `difference`: whether its value is a temperature interval."""

    expression: Expression
    statistics: tuple[Statistic, ...]
    difference: bool


def read_measure(
    text: str,
    unit: str,
    signals: Mapping[str, ValueType],
    answers: Mapping[str, ValueType],
    variables: Variables,
) -> ReadMeasure:
    """Return the expression of a measure, and the statistics that it needs.

    Parameters
    ----------
    text: as written, e.g. ``max(position) - min(position)``.
    unit: the unit in which the value is stored.
    signals: the channels and commands of which statistics can be taken.
    answers: earlier measures and operators' answers, which the expression can use.
    variables: values of ``$names``.

    Raises
    ------
    RigctlError
        the text is not an expression, a name does not exist, a channel is used without a statistic, or the
        dimension is not that of `unit`.
    """
    rewritten, statistics = find_statistics(text)
    for statistic in statistics:
        if statistic.channel not in signals:
            raise unknown_name("channel", statistic.channel, signals)
    types = {**answers, DURATION: type_of_unit("s")}
    types.update({statistic.key: _type_of(statistic, signals[statistic.channel]) for statistic in statistics})
    expression = substituted(parse(rewritten), variables)
    for name in sorted(expression.names):
        if name in signals and name not in types:
            kinds = ", ".join(f"{kind}({name})" for kind in STATISTICS)
            raise RigctlError(
                "a measure needs one value of a channel", value=name, expected=f"one of {kinds}"
            )
    found = expression.check(types)
    wanted = parse_unit(unit).dimension
    if not isinstance(found, ValueType) or found.dimension != wanted:
        raise RigctlError(
            "the value does not have the dimension of its unit", value=text, expected=describe(unit)
        )
    return ReadMeasure(expression.checked(types), statistics, found.temperature == "difference")


def _type_of(statistic: Statistic, signal: ValueType) -> ValueType:
    if statistic.difference and signal.temperature is not None:
        return ValueType(signal.dimension, "difference")
    return signal
