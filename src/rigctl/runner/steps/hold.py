"""`hold`: watch that a channel stays where it is."""

from __future__ import annotations

from rigctl.procedure.actions import Hold
from rigctl.runner.bench import Bench
from rigctl.runner.outcomes import Outcome, StepFailed
from rigctl.runner.steps.seen import reading
from rigctl.runner.waits import Behaviour, Row, Until


def hold(action: Hold, bench: Bench) -> Behaviour:
    """Let `duration` s pass while the channel stays within tolerance.

    A reading that the channel cannot have says nothing of what it measures: that is for the interlock, which
    names the sensor.

    Raises
    ------
    StepFailed
        a sample lay outside.
    """
    column = bench.columns[action.channel]
    begin = bench.now
    possible = bench.rig.channels[action.channel].possible
    row = yield from bench.fresh()
    while not possible(row[column]):
        seen = yield Until(when=lambda sample: possible(sample[column]))
        row = row if seen is None else seen
    at = row[column] if action.at is None else action.at
    low, high = at - action.within, at + action.within

    def left(sample: Row) -> bool:
        return possible(sample[column]) and not low <= sample[column] <= high

    outside = row if left(row) else (yield Until(begin + action.duration, left))
    if outside is None:
        return Outcome.COMPLETE
    tolerance = reading(bench, action.channel, action.within, difference=True)
    raise StepFailed(
        f"{action.channel} left {reading(bench, action.channel, at)} ± {tolerance} after "
        f"{max(outside[0] - begin, 0.0):.3g} s: it was {reading(bench, action.channel, outside[column])}"
    )
