"""`set`: command actuators by name."""

from __future__ import annotations

from rigctl.procedure.actions import Set
from rigctl.runner.bench import Bench
from rigctl.runner.operator import Question
from rigctl.runner.outcomes import Outcome
from rigctl.runner.waits import Behaviour, OnPause, Until


def set_values(action: Set, bench: Bench) -> Behaviour:
    """Command every actuator; with a duration, wait until the bench has returned them to their safe values.

    An actuator that is turned by hand is asked for and has to be confirmed.
    """
    for name, value in action.values.items():
        yield from bench.command(name, value, action.duration)
        actuator = bench.rig.actuators[name]
        if actuator.by == "operator":
            yield from bench.ask(Question(f"Set {name} to {actuator.show(value)}"))
    if action.duration is not None:
        end = max(bench.pulses[name].end for name in action.values)
        yield Until(end, on_pause=OnPause.DEFER)
        for name in action.values:
            yield from bench.finish_pulse(name)
    return Outcome.COMPLETE
