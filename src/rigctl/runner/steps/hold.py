"""`hold`: watch that a channel stays where it is."""

from __future__ import annotations

from rigctl.procedure.actions import Hold
from rigctl.runner.bench import Bench
from rigctl.runner.outcomes import Outcome, StepFailed
from rigctl.runner.steps.seen import reading
from rigctl.runner.waits import Behaviour, Until


def hold(action: Hold, bench: Bench) -> Behaviour:
    """Let `duration` s pass while the channel stays within tolerance.

    Raises
    ------
    StepFailed
        a sample lay outside.
    """
    column = bench.columns[action.channel]
    begin = bench.now
    row = yield from bench.fresh()
    at = row[column] if action.at is None else action.at
    low, high = at - action.within, at + action.within
    outside = row if not low <= row[column] <= high else None
    if outside is None:
        outside = yield Until(begin + action.duration, lambda sample: not low <= sample[column] <= high)
    if outside is None:
        return Outcome.COMPLETE
    tolerance = reading(bench, action.channel, action.within, difference=True)
    raise StepFailed(
        f"{action.channel} left {reading(bench, action.channel, at)} ± {tolerance} after "
        f"{max(outside[0] - begin, 0.0):.3g} s: it was {reading(bench, action.channel, outside[column])}"
    )
