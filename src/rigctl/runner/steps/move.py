"""`extend` and `retract`: by time, until a condition, or to a position."""

from __future__ import annotations

from rigctl.procedure.actions import Move
from rigctl.runner.bench import Bench
from rigctl.runner.outcomes import Outcome, StepFailed
from rigctl.runner.steps.approach import approach
from rigctl.runner.steps.seen import seen
from rigctl.runner.waits import Behaviour, OnPause, Until


def move(action: Move, bench: Bench) -> Behaviour:
    """Carry out a move; the actuator is back at its safe value when it is over, however it ends.

    Raises
    ------
    StepFailed
        the condition, or the position, was not reached in time.
    """
    if action.duration is not None:
        return _for_a_time(action, bench, action.duration)
    if action.target is not None:
        return approach(action, bench)
    return _until(action, bench)


def _for_a_time(action: Move, bench: Bench, duration: float) -> Behaviour:
    """Timed by the bench where it can be, so that delays of this computer do not move the stroke."""
    receipt = yield from bench.command(action.actuator, action.value, duration)
    yield Until(receipt.time + duration, on_pause=OnPause.DEFER)
    yield from bench.finish_pulse(action.actuator)
    return Outcome.COMPLETE


def _until(action: Move, bench: Bench) -> Behaviour:
    if action.until is None:
        raise ValueError("a move without duration, condition and target")
    condition = bench.condition(action.until)
    row = yield from bench.fresh()
    if condition(row):
        return Outcome.COMPLETE
    timeout = action.timeout or 0.0
    yield from bench.command(action.actuator, action.value)
    try:
        reached = yield Until(bench.now + timeout, condition)
    finally:
        if bench.commanded[action.actuator] == action.value:
            bench.release(action.actuator)
    if reached is None:
        names = action.until.names | ({action.position} if action.position else set())
        raise StepFailed(
            f"'{action.until.text}' was not reached within {timeout:g} s; {seen(bench, names)}",
            outcome=Outcome.TIMED_OUT,
        )
    return Outcome.COMPLETE
