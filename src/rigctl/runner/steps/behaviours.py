"""Which generator carries out which action."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rigctl.procedure.actions import Action, Heat, Hold, Measure, Move, Prompt, Set, SetLevel, Wait
from rigctl.runner.bench import Bench
from rigctl.runner.steps.heat import heat
from rigctl.runner.steps.hold import hold
from rigctl.runner.steps.measure import measure
from rigctl.runner.steps.move import move
from rigctl.runner.steps.prompt import prompt
from rigctl.runner.steps.set_level import set_level
from rigctl.runner.steps.set_values import set_values
from rigctl.runner.steps.wait import wait
from rigctl.runner.waits import Behaviour

_BEHAVIOURS: dict[type, Callable[[Any, Bench], Behaviour]] = {
    Heat: heat,
    SetLevel: set_level,
    Move: move,
    Hold: hold,
    Wait: wait,
    Set: set_values,
    Prompt: prompt,
    Measure: measure,
}


def behaviour(action: Action, bench: Bench) -> Behaviour:
    """The generator that carries out `action` on `bench`."""
    return _BEHAVIOURS[type(action)](action, bench)
