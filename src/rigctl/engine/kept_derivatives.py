"""Derivatives of a record that are kept while it has hardly moved.

A derivative through a foreign program is a difference, which takes simulations; the outputs at a new point
take one. Towards the end of a fit the unknowns move by ever less, and the derivatives with them. They are
kept where every unknown has moved by less than `NEAR` of what it is, and the outputs moved as the derivatives
predict: they are then as accurate as differences that agree (`rigctl.engine.cascade`). A comparison tests the
columns of a whole library, which are others than a fit has, and so made anew at its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigctl.engine.excitation import Excitation, Floats

#: of a parameter's value, of a sampling interval, and of a change of a state that matters
NEAR: Final = 0.02
#: relative accuracy of a program's outputs, within which no move is predicted
_ACCURACY: Final = 1e-6
#: switches that no unknown moves have not moved by more than this share of those that have
_ALIKE: Final = 1e-3


@dataclass(frozen=True)
class Kept:
    """The derivatives of a record, and where they were made.

    Attributes
    ----------
    columns: their names.
    excitation, outputs: of the record then; (samples, outputs).
    slopes: (samples, outputs, columns), all of the derivatives.
    through: those through the program alone.
    """

    columns: tuple[str, ...]
    excitation: Excitation
    outputs: Floats
    slopes: Floats
    through: Floats

    @property
    def numbers(self) -> int:
        """How many numbers it holds."""
        return self.slopes.size + self.through.size + self.outputs.size

    def hold(self, now: Excitation, outputs: Floats, moves: Moves) -> bool:
        """Whether they still hold for the record as it is now, with these outputs."""
        moved = moves.between(self.excitation, now)
        if moved is None or outputs.shape != self.outputs.shape:
            return False
        change = outputs - self.outputs
        error = np.linalg.norm(change - self.slopes @ moved, axis=0)
        least = _ACCURACY * np.linalg.norm(outputs, axis=0)
        return bool(np.all(error <= NEAR * np.linalg.norm(change, axis=0) + least))


@dataclass(frozen=True)
class Moves:
    """What the columns of derivatives move.

    Attributes
    ----------
    columns: how many there are.
    parameters, initial: of each parameter and each initial state with a column, its index and its column.
    aside: the indices of parameters that act on the times of commands alone.
    scales: of the initial states, a change that matters, SI.
    first: the first of the columns that move switches, which are the last.
    interval: between two samples, s.
    """

    columns: int
    parameters: Sequence[tuple[int, int]]
    initial: Sequence[tuple[int, int]]
    aside: Sequence[int]
    scales: Floats
    first: int
    interval: float

    def between(self, before: Excitation, now: Excitation) -> Floats | None:
        """(columns) by how much the unknowns moved; None if one moved too far, or something else did."""
        if not _same_record(before, now):
            return None
        moved = np.zeros(self.columns)
        change = now.parameters - before.parameters
        change[list(self.aside)] = 0.0
        for index, column in self.parameters:
            if abs(change[index]) > NEAR * abs(before.parameters[index]):
                return None
            moved[column], change[index] = change[index], 0.0
        start = now.initial - before.initial
        for (index, column), scale in zip(self.initial, self.scales, strict=True):
            if abs(start[index]) > scale:
                return None
            moved[column], start[index] = start[index], 0.0
        late = now.switch_times - before.switch_times
        if change.any() or start.any() or np.abs(late).max() > NEAR * self.interval:
            return None
        if late.any():
            if before.shifts is None or not before.shifts.size:
                return None
            moved[self.first :] = np.linalg.lstsq(before.shifts, late)[0]
            unexplained = before.shifts @ moved[self.first :] - late
            if np.abs(unexplained).max() > _ALIKE * np.abs(late).max():
                return None
        return moved


def _same_record(before: Excitation, now: Excitation) -> bool:
    """Whether two are of the same samples and commands, at whatever values of the unknowns."""
    pairs = (
        (before.times, now.times),
        (before.inputs, now.inputs),
        (before.shifts, now.shifts),
    )
    return (
        before.ramps is now.ramps
        and before.switch_times.shape == now.switch_times.shape
        and all(
            one is other or (one is not None and other is not None and np.array_equal(one, other))
            for one, other in pairs
        )
    )
