"""`set_pressure` and its like: bring a level to where a channel reads the set-point."""

from __future__ import annotations

from rigctl.procedure.actions import SetLevel
from rigctl.runner.bench import Bench
from rigctl.runner.operator import Question
from rigctl.runner.outcomes import Outcome, StepFailed
from rigctl.runner.smoothing import Settling
from rigctl.runner.steps.seen import reading
from rigctl.runner.waits import Behaviour, Until, every_sample


def set_level(action: SetLevel, bench: Bench) -> Behaviour:
    """Command the level, or ask the operator to turn it, and watch the channel until it has settled.

    Raises
    ------
    StepFailed
        it did not settle within `timeout` s; says what was seen.
    """
    actuator = bench.rig.actuators[action.actuator]
    target = reading(bench, action.channel, action.to)
    yield from bench.command(action.actuator, action.to)
    if actuator.by == "operator":
        request = actuator.prompt or f"Turn {action.actuator} until {action.channel} reads"
        bench.tell(Question(f"{request} {target}", notice=True))
    try:
        settling = Settling(action.to, action.within, action.settle)
        column = bench.columns[action.channel]
        give_up = bench.now + action.timeout
        row = yield Until(give_up, every_sample)
        while row is not None and not settling.add(row[0], row[column]):
            row = yield Until(give_up, every_sample)
    finally:
        bench.withdraw()
    if row is None:
        tolerance = reading(bench, action.channel, action.within, difference=True)
        lowest, highest = (reading(bench, action.channel, v) for v in (settling.lowest, settling.highest))
        raise StepFailed(
            f"{action.channel} did not settle at {target} ± {tolerance} within {action.timeout:g} s: it was "
            f"{reading(bench, action.channel, settling.mean)}, lowest {lowest}, highest {highest}",
            outcome=Outcome.TIMED_OUT,
        )
    return Outcome.COMPLETE
