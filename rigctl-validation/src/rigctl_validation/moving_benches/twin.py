"""A moving twin: what is drawn, what excites it, what it can hide, and what is read of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rigctl.errors import unknown_name
from rigctl_validation.benches.bench import Floats, SmallBench
from rigctl_validation.moving_benches.excitation import Motion

#: columns in the file's units from states, inputs, drawn values and amplitudes
Readings = Callable[[Floats, Floats, Floats, Floats], Mapping[str, Floats]]


@dataclass(frozen=True)
class Drawn:
    """A value that differs between benches by the share `spread` of its nominal one; `si` converts it."""

    parameter: str
    nominal: float
    spread: float
    si: float = 1.0


@dataclass(frozen=True)
class Driven:
    """An input.

    Attributes
    ----------
    middle, swing: its range, in the unit of its column.
    held: a command keeps its value until the next sample; a measured input is straight between samples.
    excited: it carries the excitation; another one wanders slowly through its range.
    rest: its value in a free decay; None for `middle`.
    """

    column: str
    middle: float
    swing: float
    held: bool = True
    excited: bool = True
    rest: float | None = None


@dataclass(frozen=True)
class MovingHidden:
    """What a twin can hide.

    Attributes
    ----------
    place: of its amplitude among the amplitudes of the equations.
    typical, largest: amplitudes; beyond the largest the bench would not work.
    counts_as: names of effects that are a right answer.
    exact: the effect with the same law and its parameter, whose true value is `truth(amplitude, drawn)`.
    only: motions under which it acts; empty for all.
    """

    name: str
    place: int
    typical: float
    largest: float
    counts_as: tuple[str, ...]
    exact: tuple[str, str] | None = None
    truth: Callable[[float, Floats], float] = field(default=lambda amplitude, _: amplitude, repr=False)
    only: tuple[str, ...] = ()


@dataclass(frozen=True)
class Twin:
    """A bench of `rigctl_validation.benches` that never rests.

    Attributes
    ----------
    bench: has the user's files, the columns and the white noise.
    drawn, inputs, hidden: see their classes; the inputs in the order of the equations.
    start: the states at the start of a record; `released` those of a free decay, None if it has none.
    free: the states that begin with a channel's first reading, whose values a model fits: by channel.
    decay: duration of a free decay, s.
    limits: largest magnitude of a column, to which the excitation is reduced.
    """

    bench: SmallBench
    drawn: tuple[Drawn, ...]
    inputs: tuple[Driven, ...]
    hidden: tuple[MovingHidden, ...]
    start: tuple[float, ...]
    free: tuple[tuple[int, ...], ...]
    read: Readings = field(repr=False)
    released: tuple[float, ...] | None = None
    decay: float = 0.0
    limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """That of its bench."""
        return self.bench.name

    @property
    def time_constant(self) -> float:
        """s; 1 s for a bench without states."""
        return self.bench.time_constant or 1.0

    def moves(self, motion: Motion) -> bool:
        """Whether it can be moved so: not every bench decays freely."""
        return motion != "decay" or self.decay > 0.0

    def acting(self, motion: Motion) -> list[str]:
        """The names of what it hides that acts in this motion."""
        return [each.name for each in self.hidden if not each.only or motion in each.only]

    def find(self, name: str) -> MovingHidden:
        """What it hides under this name.

        Raises
        ------
        RigctlError
            it hides nothing of that name.
        """
        for hidden in self.hidden:
            if hidden.name == name:
                return hidden
        raise unknown_name("hidden effect", name, [hidden.name for hidden in self.hidden])


def columns(names: Sequence[str], table: Floats) -> dict[str, Floats]:
    """The columns of a (samples, columns) table by name."""
    return {name: np.asarray(table[:, k]) for k, name in enumerate(names)}
