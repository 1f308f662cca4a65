"""The settings of the workbench, with undo.

    state = (value of every slider, effects that are on)

A value is kept while its effect is off, so that switching it on again restores the previous state.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from rigctl.errors import RigctlError, require_known

#: most undo steps
_REMEMBERED = 200


@dataclass(frozen=True)
class State:
    """The sliders and the switches.

    Attributes
    ----------
    values: SI, by the names of a model's values; also for effects that are off.
    on: the effects that the model has, base physics included.
    """

    values: Mapping[str, float]
    on: frozenset[str]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))

    def __hash__(self) -> int:
        return hash((frozenset(self.values.items()), self.on))

    def moved(self, values: Mapping[str, float]) -> State:
        """The state with other values of some sliders.

        Raises
        ------
        RigctlError
            there is no such slider.
        """
        require_known("slider", values, self.values)
        return replace(self, values={**self.values, **values})

    def switched(self, effects: Iterable[str], *, on: bool) -> State:
        """The state with effects switched on or off."""
        names = frozenset(effects)
        return replace(self, on=self.on | names if on else self.on - names)


@dataclass(frozen=True)
class Track:
    """The present state, with its undo and redo steps; immutable."""

    present: State
    past: tuple[State, ...] = field(default=(), repr=False)
    future: tuple[State, ...] = field(default=(), repr=False)

    def then(self, state: State) -> Track:
        """The track with a new step, its redo steps discarded; unchanged if the state is the present one."""
        if state == self.present:
            return self
        return Track(state, (*self.past, self.present)[-_REMEMBERED:])

    def undone(self) -> Track:
        """The track one step back.

        Raises
        ------
        RigctlError
            there is none.
        """
        if not self.past:
            raise RigctlError("there is nothing to undo")
        return Track(self.past[-1], self.past[:-1], (self.present, *self.future))

    def redone(self) -> Track:
        """The track with the last undone step restored.

        Raises
        ------
        RigctlError
            there is none.
        """
        if not self.future:
            raise RigctlError("there is nothing to redo")
        return Track(self.future[0], (*self.past, self.present), self.future[1:])
