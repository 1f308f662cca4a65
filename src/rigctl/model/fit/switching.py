"""When commands acted, where a logger wrote them down beside its samples.

A command that is first seen beside sample k was given after sample k − 1: its time is known to within one
interval, ``t = m + 2h·w + d``, m the interval's middle, h its half-width. w is the logger's habit, the same
for every switch of a kind in a campaign: at the sample before, between the two, or after the sample it is
written beside (−½, 0, ½; up to 3/2 where commands are written a sample early). Kinds are switches to more, to
less and to 0: what a host switches on, a board's clock may switch off. d is each switch's own. Both have the
variance of a uniform distribution over the interval as their prior, and both have exact derivatives: see
`rigctl.engine.excitation.Excitation.shifts`. A record with many switches has one d for all of them, and what
each has beside it is part of the noise: a hundred unknowns would be slow, and of no use to anyone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import qualified
from rigctl.effects.record_level import RECORD, SWITCHING
from rigctl.engine.least_squares import Prior, Unknown
from rigctl.model.measured.record import MeasuredRecord, Measurements

Floats = NDArray[np.float64]

#: the logger's habits, unknowns of all records, in sampling intervals
HABITS = tuple(qualified(RECORD, name) for name in SWITCHING)
#: what moves every switch of one record alike, s
ALL = qualified(RECORD, "switches")
#: a record with more switches has no unknown for each
MOST_SWITCHES = 6

#: so many of a record's switches scatter at the most
_MOST_SCATTERED = 60
#: standard deviation of a uniform distribution, in half-widths
_UNIFORM = 1.0 / math.sqrt(3.0)


def switch_name(k: int) -> str:
    """What the unknown of a record's switch k is called."""
    return qualified(RECORD, f"switch_{k}")


def moves_switches(name: str) -> bool:
    """Whether an unknown of this name moves the times of commands, and nothing else."""
    return name in HABITS or name == ALL or name.startswith(switch_name(0)[:-1])


def habit_unknowns(measurements: Measurements) -> list[Unknown]:
    """The logger's habits, of the kinds of switches whose times are not exact."""
    seen = {HABITS[kind] for r in measurements.records for kind in r.switch_kinds[r.rough_switches]}
    return [
        Unknown(name, 0.0, -0.5, 1.5, scale=0.5, prior=Prior(0.0, 0.5 * _UNIFORM))
        for name in HABITS
        if name in seen
    ]


def switch_unknowns(record: MeasuredRecord) -> list[Unknown]:
    """What moves each switch of a record, or all of them where there are many; in s."""
    indices = record.rough_switches
    if not indices.size:
        return []
    if indices.size > MOST_SWITCHES:
        return [_moved_by(ALL, float(np.median(record.switch_half[indices])))]
    return [_moved_by(switch_name(int(k)), float(record.switch_half[k])) for k in indices]


def _moved_by(name: str, half: float) -> Unknown:
    return Unknown(name, 0.0, -half, half, scale=half, prior=Prior(0.0, half * _UNIFORM), unit="s")


def switch_shifts(record: MeasuredRecord, names: Sequence[str]) -> Floats:
    """(switches, names) by how much each quantity moves each switch, s per unit of it."""
    shifts = np.zeros((record.switch_times.size, len(names)))
    indices = record.rough_switches
    for column, name in enumerate(names):
        if name in HABITS:
            of_kind = indices[record.switch_kinds[indices] == HABITS.index(name)]
            shifts[of_kind, column] = 2.0 * record.switch_half[of_kind]
        elif name == ALL:
            shifts[indices, column] = 1.0
        else:
            k = int(name.rsplit("_", 1)[1])
            shifts[indices[indices == k], column] = 1.0
    return shifts


def scattered(record: MeasuredRecord) -> tuple[tuple[str, ...], Floats]:
    """The switches of a record that are no unknowns, and the standard deviations of their times, s.

    They are those whose commands change most where there are very many.
    """
    indices = record.rough_switches
    if indices.size <= MOST_SWITCHES:
        return (), np.empty(0)
    width = np.ptp(record.inputs, axis=0)
    jumps = np.abs(np.diff(record.inputs, axis=0)) / np.where(width > 0.0, width, 1.0)
    size = jumps.sum(axis=1)[indices - 1]
    chosen = np.sort(indices[np.argsort(-size, kind="stable")[:_MOST_SCATTERED]])
    return tuple(switch_name(int(k)) for k in chosen), record.switch_half[chosen] * _UNIFORM


def moved_times(record: MeasuredRecord, values: dict[str, float]) -> Floats:
    """When the commands acted, for values of the quantities that move them: none before the first."""
    if not values:
        return record.switch_times
    moved = record.switch_times + switch_shifts(record, tuple(values)) @ np.array(list(values.values()))
    return np.maximum.accumulate(moved)
