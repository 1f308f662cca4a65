"""What differs from record to record although nobody meant it: settings, zeros, switch times, starts.

Such quantities are unknowns of one record each, with a prior. They act at the slots of a family like effects
do, so they are written as one: its parameters then belong to each record instead of the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Literal

from rigctl.effects.declaration import Effect, qualified
from rigctl.physics.family import ModelFamily
from rigctl.rig.rig import Rig

#: what the effect of every family's record-level quantities is called
RECORD = "record"


@dataclass(frozen=True)
class Quantity:
    """A parameter of the record-level effect, and what is known of it before a record is looked at.

    Attributes
    ----------
    parameter: of the effect.
    meaning: for people.
    std: of its prior around the null, SI, from the rig; None leaves it to the switch times' uncertainty.
    switch: the value commanded before and after, of the switches whose time it moves; None for no switch.
    """

    parameter: str
    meaning: str
    std: Callable[[Rig | None], float] | None = None
    switch: tuple[float, float] | None = None

    @property
    def name(self) -> str:
        """The parameter as a system knows it."""
        return qualified(RECORD, self.parameter)


@dataclass(frozen=True)
class Start:
    """The value of a state at the start of a record.

    Attributes
    ----------
    state: of the family.
    how: "measured" starts at what the channel of the same name first reads, and is free; "set" is a share
        of an input at the start, with a prior; "rest" is known to within `rest`, around what the channel
        reads where that is farther from 0, else around its value `at_rest`.
    input, share, spread: for "set": the state starts at share·input, with a standard deviation spread·input.
    rest: for "rest", SI.
    at_rest: for "rest", the state's value there, of the other states and the model's parameters, SI; 0 when
        left out.
    """

    state: str
    how: Literal["measured", "set", "rest"]
    input: str = ""
    share: float = 1.0
    spread: float = 0.0
    rest: float = 0.0
    at_rest: Callable[[Mapping[str, float], Mapping[str, float]], float] | None = None


@dataclass(frozen=True)
class RecordLevel:
    """The record-level quantities of a family.

    Attributes
    ----------
    effect: whose parameters they are; None when there are none.
    quantities: its parameters, each once.
    starts: of the states that do not start as the family's usually do.
    shared_switch: the effect's parameter that moves every switch of every record alike: a logger that writes
        a command down after its samples is late always.
    """

    effect: Effect | None = None
    quantities: tuple[Quantity, ...] = ()
    starts: tuple[Start, ...] = ()
    shared_switch: str | None = None

    @property
    def null(self) -> dict[str, dict[str, float]]:
        """The effect with its parameters at their null, as a system is told of effects."""
        return {} if self.effect is None else {self.effect.name: self.effect.null}


@lru_cache(maxsize=1)
def _known() -> Mapping[str, RecordLevel]:
    from rigctl.effects import heater_board, hydraulic_cylinder

    return MappingProxyType(
        {
            "hydraulic_cylinder": hydraulic_cylinder.RECORD_LEVEL,
            "heater_board": heater_board.RECORD_LEVEL,
        }
    )


def record_level(family: ModelFamily) -> RecordLevel:
    """What differs between records of a family.

    A family that says nothing starts every state from the channel of its name.
    """
    found = _known().get(family.name)
    if found is not None:
        return found
    read = {output.name for output in family.outputs}
    return RecordLevel(starts=tuple(Start(s.name, "measured") for s in family.states if s.name in read))
