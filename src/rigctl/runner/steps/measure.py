"""`measure`: a value from recorded data, compared with its limits."""

from __future__ import annotations

import math

from rigctl.procedure.actions import Measure, Missed
from rigctl.runner.bench import Bench
from rigctl.runner.outcomes import Outcome, StepFailed
from rigctl.runner.waits import CHECKPOINT, Behaviour
from rigctl.units import show


def measure(action: Measure, bench: Bench) -> Behaviour:
    """Compute the value and keep it with the open record, or with the run.

    Raises
    ------
    StepFailed
        there is no value, or it lies outside its limits and the procedure says that the run fails then.
    """
    yield CHECKPOINT
    value = float(action.expression.evaluate(bench.statistics(action)))
    passed = action.passes(value)
    unit, difference = action.unit, action.difference
    bench.keep(action.name, value, unit, difference=difference)
    bench.writer.measure(
        action.name, value, unit, action.low, action.high, passed=passed, difference=difference
    )
    if passed:
        return Outcome.COMPLETE
    found = "has no value" if math.isnan(value) else f"is {show(value, unit, difference=difference)}"
    text = f"{action.name} {found}, expected {_limits(action)}"
    if action.missed is Missed.FAIL:
        raise StepFailed(text, outcome=Outcome.MISSED)
    bench.event("note", text)
    bench.missed.append(text)
    return Outcome.MISSED


def _limits(action: Measure) -> str:
    def shown(value: float) -> str:
        return show(value, action.unit, difference=action.difference)

    if action.low is not None and action.high is not None:
        return f"{shown(action.low)} to {shown(action.high)}"
    if action.low is not None:
        return f"at least {shown(action.low)}"
    if action.high is not None:
        return f"at most {shown(action.high)}"
    return "a number"
