"""Steps and differences of records: the derivatives of what a foreign program computes.

Two differences from the point give the derivative of the parabola through the three, or one small step alone.
Which are used is decided in `rigctl.engine.cascade`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from rigctl.engine.excitation import Excitation, Floats

#: usual step of a parameter, as a share of its value; of what changes a drive, of the drive's mean magnitude
SHARE: Final = 3e-3
#: of what moves switches, in sampling intervals
MOVED: Final = 0.2
#: the least of those, the share of the time to the next sample, and how near to a sample a switch is at it
_LEAST_MOVED: Final = 0.01
_ROOM: Final = 0.8
_AT_SAMPLE: Final = 1e-6
#: the digits to which two switches move in proportion
_DIGITS: Final = 12


@dataclass(frozen=True)
class Step:
    """How a column is differenced: by two steps, this share of the usual ones, or the second alone.

    Attributes
    ----------
    apart: by how much the derivatives by two such pairs of steps differed, as a share: their accuracy.
    """

    share: float
    alone: bool = False
    apart: float = field(default=0.0, compare=False)


@dataclass(frozen=True)
class Change:
    """What is moved for one column: a parameter or an initial state by its index, or the switches.

    Attributes
    ----------
    size: the usual step, SI; of switches it follows from the record (`_within`).
    keeps_drives: whether the program is given the same.
    acting: (switches, k) of switches, the times at which what each switches acts; NaN for none.
    """

    kind: str
    index: int
    size: float = 1.0
    keeps_drives: bool = False
    acting: Floats | None = field(default=None, compare=False, repr=False)

    def steps(self, excitation: Excitation, share: float) -> tuple[float, float]:
        """Two steps from the point: to either side, or both to one for a value of 0 and for switches."""
        if self.kind == "shift":
            step = share * self._within(excitation)
            return step, 0.5 * step
        step = share * self.size
        if self.kind == "initial":
            return step, -step
        value = float(excitation.parameters[self.index])
        if abs(value) <= step:
            return (-step, -0.5 * step) if value < 0.0 else (step, 0.5 * step)
        return step, -step

    def _within(self, excitation: Excitation) -> float:
        """A step by which switches move, to the side on which the next sample is farther, and not up to it.

        Where a command acts at a sample the cost has a corner. One at a sample, as a log has it, moves later:
        the exact derivatives of equations are those on that side, where the sample is before it.
        """
        assert excitation.shifts is not None  # noqa: S101 - it has the columns
        shifts, interval = excitation.shifts[:, self.index], interval_of(excitation)
        most = float(np.abs(shifts).max(initial=0.0))
        if not most:
            return MOVED * interval
        acting = excitation.switch_times if self.acting is None else self.acting
        times, at = excitation.times, acting[shifts != 0.0]
        at = at[np.isfinite(at)]
        following = np.searchsorted(times, at + _AT_SAMPLE * interval, side="right")
        inside = (following > 0) & (following < times.size)
        after = float((times[following[inside]] - at[inside]).min(initial=interval))
        ago = float((at[inside] - times[following[inside] - 1]).min(initial=interval))
        room = _ROOM * max(after, ago) if ago > _AT_SAMPLE * interval else _ROOM * after
        step = min(max(room, _LEAST_MOVED * interval), MOVED * interval) / most
        return -step if ago > after else step

    def moved(self, excitation: Excitation, step: float) -> Excitation:
        """The record moved by a step."""
        if self.kind == "shift":
            assert excitation.shifts is not None  # noqa: S101
            times = excitation.switch_times + step * excitation.shifts[:, self.index]
            times = np.maximum.accumulate(np.maximum(times, excitation.switch_times[0]))
            return replace(excitation, switch_times=times)
        if self.kind == "initial":
            initial = excitation.initial.copy()
            initial[self.index] += step
            return replace(excitation, initial=initial)
        parameters = excitation.parameters.copy()
        parameters[self.index] += step
        return replace(excitation, parameters=parameters)


def grouped(shifts: Floats) -> tuple[Floats, Floats]:
    """Factors (switches, groups) and (groups, columns) of `shifts`: the switches of a group move in
    proportion, whatever moves them. Each column for itself where there are no fewer groups."""
    size = np.abs(shifts).max(axis=1, initial=0.0)
    moving = np.flatnonzero(size)
    rows, group = np.unique(
        np.round(shifts[moving] / size[moving, None], _DIGITS), axis=0, return_inverse=True
    )
    if len(rows) >= shifts.shape[1]:
        most = np.abs(shifts).max(axis=0, initial=0.0)
        return shifts / np.where(most > 0.0, most, 1.0), np.diag(most)
    alike = np.zeros((len(shifts), len(rows)))
    alike[moving, group.ravel()] = size[moving]
    return alike, rows


def slope_of(ends: Sequence[tuple[float, Floats]]) -> Floats:
    """The derivative from one difference to the point, or two: the parabola through the three."""
    (a, at_a), (b, at_b) = ends[0], ends[-1]
    if len(ends) == 1:
        return np.asarray(at_a / a)
    if not np.isfinite(at_a).all():
        return at_b / b
    if not np.isfinite(at_b).all():
        return at_a / a
    return np.asarray((at_a * b / a - at_b * a / b) / (b - a))


def relative_difference(one: Floats, other: Floats) -> float:
    """By how much two derivatives differ, as a share of the larger."""
    size = max(float(np.linalg.norm(one)), float(np.linalg.norm(other)))
    return float(np.linalg.norm(one - other)) / size if size else 0.0


def interval_of(excitation: Excitation) -> float:
    """The usual time from sample to sample, s."""
    if excitation.times.size < 2:
        return 1.0
    return float(np.median(np.diff(excitation.times))) or 1.0
