"""Commands levels no faster than the rig file allows."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rigctl.plan.behaviour import StepBench, Until, Waiting

#: s between two commands on the way to a level
_PERIOD = 0.1


def approach(bench: StepBench, levels: Mapping[str, float]) -> Waiting:
    """Bring actuators from their present commands to levels, SI, together, each at its ``max_rate``.

    An actuator without one is commanded at once. Only the safe state is never approached slowly: endings and
    pauses command it without this.
    """
    begins = {name: bench.commanded.get(name, bench.safe_value(name)) for name in levels}
    begin, left = bench.now, dict(levels)
    try:
        # While they move, a loss of contact that switches them off ends nothing: the next command sets them
        # again.
        bench.regulated.update(levels)
        while left:
            for name, level in list(left.items()):
                fastest = bench.rig.actuators[name].max_rate
                # By the time that has passed, not by a count of steps: a late host makes a larger step, at
                # the same rate.
                way = math.inf if fastest is None else fastest * (bench.now - begin)
                rest = level - begins[name]
                now = level if abs(rest) <= way else begins[name] + math.copysign(way, rest)
                if way > 0.0 or rest == 0.0:
                    yield from bench.command(name, now)
                if now == level:
                    del left[name]
            if left:
                yield Until(bench.now + _PERIOD)
    finally:
        bench.regulated.difference_update(levels)


def approach_time(begin: float, level: float, max_rate: float | None) -> float:
    """Return the time from one level to another, s."""
    return 0.0 if max_rate is None else abs(level - begin) / max_rate
