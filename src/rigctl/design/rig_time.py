"""The cost of records: bench time for heating, settling and recording, and the order in which it is least.

Hundreds of candidates are timed by the forecasts of their steps; the proposed records by the preview of their
procedure, as shown by `rigctl check`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

from rigctl.design.procedure_text import HEAT, HOME, PRESS, Writer
from rigctl.design.recipe import Recipe
from rigctl.errors import RigctlError
from rigctl.plan.action import Action
from rigctl.plan.forecast import State
from rigctl.planning.bench import ForecastBench, bench_of, initial_state
from rigctl.planning.preview import Preview, preview
from rigctl.procedure.expand import expand
from rigctl.procedure.load import parse_procedure
from rigctl.rig.rig import Rig
from rigctl.steps.heat import Heat
from rigctl.steps.move import Move
from rigctl.steps.set_pressure import SetLevel
from rigctl.steps.wait import Wait

#: up to this number of records every order is tried
_EVERY_ORDER = 4


@dataclass(frozen=True)
class Ordered:
    """Records in an order, and the bench time of each including all that precedes it, s."""

    order: tuple[int, ...]
    each: tuple[float, ...]

    @property
    def seconds(self) -> float:
        """Duration of all records together, s."""
        return sum(self.each)


@dataclass(frozen=True)
class RigTime:
    """Times records on one rig, starting from the state given in the rig file."""

    rig: Rig

    @cached_property
    def bench(self) -> ForecastBench:
        """The bench as used by forecasts."""
        return bench_of(self.rig)

    @cached_property
    def start(self) -> State:
        """The initial state of the bench."""
        return initial_state(self.bench)

    def in_order(self, recipes: Sequence[Recipe]) -> tuple[float, ...]:
        """The bench time of each recipe, s, if carried out in this order."""
        # The state is carried from record to record: a tank that is warm already needs little heating.
        state, at, each = self.start, None, []
        for recipe in recipes:
            spent = 0.0
            for action in self._actions(recipe, heat=recipe.temperature != at):
                expected = action.forecast(state, self.bench)
                spent, state = spent + expected.seconds, expected.state
            at = recipe.temperature
            each.append(spent)
        return tuple(each)

    def rising(self, recipes: Sequence[Recipe]) -> Ordered:
        """The recipes in the order of their temperatures, because a tank is slow to cool."""
        return self._ordered(
            recipes, sorted(range(len(recipes)), key=lambda k: recipes[k].temperature or 0.0)
        )

    def quickest(self, recipes: Sequence[Recipe]) -> Ordered:
        """The recipes in the order that takes the least bench time; many are ordered by temperature."""
        rising = self.rising(recipes)
        if len(recipes) > _EVERY_ORDER:
            return rising
        others = [self._ordered(recipes, order) for order in permutations(rising.order)]
        return min((rising, *others), key=lambda one: one.seconds)

    def _ordered(self, recipes: Sequence[Recipe], order: Sequence[int]) -> Ordered:
        return Ordered(tuple(order), self.in_order([recipes[k] for k in order]))

    def _actions(self, recipe: Recipe, *, heat: bool) -> list[Action]:
        """The actions of the steps that `Writer` writes."""
        roles, actions = self.rig.roles, list[Action]()
        if recipe.temperature is not None and roles.heat is not None and heat:
            role = roles.heat
            actions.append(
                Heat(role.actuator, role.channel, recipe.temperature, HEAT.within, HEAT.settle, HEAT.timeout)
            )
        if recipe.moves and roles.retract is not None and roles.retract.position is not None:
            actions.append(self._move(-1, None))
        if recipe.pressure is not None and roles.set_pressure is not None:
            by = roles.set_pressure
            actions.append(
                SetLevel(by.actuator, by.channel, recipe.pressure, 0.0, PRESS.settle, PRESS.timeout)
            )
        actions.append(Wait(recipe.rest))
        for step in recipe.steps:
            direction = {"extend": 1, "retract": -1}.get(step.verb)
            actions.append(Wait(step.seconds) if direction is None else self._move(direction, step.seconds))
        return actions

    def _move(self, direction: int, seconds: float | None) -> Move:
        role = self.rig.roles.extend if direction > 0 else self.rig.roles.retract
        assert role is not None  # noqa: S101 - a recipe moves only where the rig says how
        value = self.rig.actuators[role.actuator].read(role.value.text)
        timeout = HOME.timeout if seconds is None else None
        return Move(1 if direction > 0 else -1, role.actuator, value, role.position, seconds, timeout=timeout)


def forecast(writer: Writer, recipes: Sequence[Recipe]) -> Preview | None:
    """The preview of a procedure; None if the rig refuses it, or it will most probably fail."""
    try:
        result = preview(expand(parse_procedure(writer.text(recipes)), writer.rig))
    except RigctlError:
        return None
    return None if result.warnings else result
