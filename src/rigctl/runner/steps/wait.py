"""`wait`: let time pass, or wait for a condition."""

from __future__ import annotations

from rigctl.procedure.actions import Wait
from rigctl.runner.bench import Bench
from rigctl.runner.outcomes import Outcome, StepFailed
from rigctl.runner.steps.seen import seen
from rigctl.runner.waits import Behaviour, Until


def wait(action: Wait, bench: Bench) -> Behaviour:
    """Wait `duration` s, or until the condition holds.

    Raises
    ------
    StepFailed
        the condition did not come true within `timeout` s.
    """
    if action.until is None:
        yield Until(bench.now + (action.duration or 0.0))
        return Outcome.COMPLETE
    condition = bench.condition(action.until)
    timeout = action.timeout or 0.0
    give_up = bench.now + timeout
    row = yield from bench.fresh()
    if not condition(row) and (yield Until(give_up, condition)) is None:
        raise StepFailed(
            f"'{action.until.text}' did not come true within {timeout:g} s; "
            f"{seen(bench, action.until.names)}",
            outcome=Outcome.TIMED_OUT,
        )
    return Outcome.COMPLETE
