"""`prompt`: ask the operator, and keep the answer as data."""

from __future__ import annotations

from rigctl.procedure.actions import Prompt
from rigctl.runner.bench import Bench
from rigctl.runner.operator import Question
from rigctl.runner.outcomes import Outcome
from rigctl.runner.waits import Behaviour


def prompt(action: Prompt, bench: Bench) -> Behaviour:
    """Wait for a confirmation or a value; samples and interlocks go on meanwhile."""
    question = Question(
        text=action.question,
        name=action.name,
        unit=action.unit,
        low=action.low,
        high=action.high,
        simulated=action.simulated,
    )
    answer = yield from bench.ask(question)
    if action.name is not None and answer.value is not None:
        unit = action.unit or "1"
        bench.keep(action.name, answer.value, unit)
        bench.writer.measure(action.name, answer.value, unit, action.low, action.high, passed=True)
    return Outcome.COMPLETE
