"""The times at which commands acted, if a logger recorded them together with its samples.

A command first recorded with sample k was given after sample k − 1: its time is known to within one interval,
``t = m + 2h·w + d``, m the interval's midpoint, h its half-width. w is the logger's delay, the same for every
switch of a kind in a campaign: the command acted at the preceding sample, between the two, or at the sample
with which it is recorded (−½, 0, ½; up to 3/2 if commands are recorded a sample early). Kinds are switches to
a larger value, to a smaller one and to 0: switches on by a host, for example, and off by a board's clock. d
is each switch's own. Both have the variance of a uniform distribution over the interval as their prior, and
both have exact derivatives: see `rigctl.engine.excitation.Excitation.shifts`. A record with many switches has
one d for all of them, and the rest of each is part of the noise, to first order. Where a time constant is as
short as the sampling interval that is a poor approximation: if with up to a hundred unknowns the error falls
to the white floor of the noise, they are unknowns (`MeasuredRecord.separate_switches`), which costs a
simulation several times as much. Commands that change with most of the samples have one delay, and no d but
one for all of them (`MeasuredRecord.streamed`).

An actuator whose rig file states a ``jitter`` acts each time at a time of its own, also if commands were
recorded exactly: d then has that variance too, and a normal prior.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.effects.declaration import qualified
from rigctl.effects.record_level import RECORD, SWITCHING
from rigctl.engine.least_squares import Prior, Unknown
from rigctl.model.measured.record import UNIFORM, MeasuredRecord, Measurements

Floats = NDArray[np.float64]

#: the logger's delays, unknowns common to all records, in sampling intervals
LOGGER_DELAYS = tuple(qualified(RECORD, name) for name in SWITCHING)
#: common shift of all switches of one record, s
ALL = qualified(RECORD, "switches")
#: largest number of switches with an unknown each, always and if the data ask for it
MOST_SWITCHES, MOST_SEPARATE = 6, 100

#: largest number of a record's switches whose times scatter as part of the noise
_MOST_SCATTERED = 60
#: a switch is looked for within this many standard deviations of its jitter
_WITHIN = 4.0


def switch_name(k: int) -> str:
    """The name of the unknown of a record's switch k."""
    return qualified(RECORD, f"switch_{k}")


def moves_switches(name: str) -> bool:
    """Whether an unknown with this name moves only the times of commands."""
    return name in LOGGER_DELAYS or name == ALL or name.startswith(switch_name(0)[:-1])


def logger_delay_unknowns(measurements: Measurements) -> list[Unknown]:
    """The logger's delays, for the kinds of switches whose times are not exact."""
    present = {
        LOGGER_DELAYS[kind] for r in measurements.records for kind in r.switch_kinds[r.logged_switches]
    }
    return [
        Unknown(name, 0.0, -0.5, 1.5, scale=0.5, prior=Prior(0.0, 0.5 * UNIFORM))
        for name in LOGGER_DELAYS
        if name in present
    ]


def switch_unknowns(record: MeasuredRecord) -> list[Unknown]:
    """The time shifts of the switches of a record, or of all of them together if there are many; s."""
    indices = record.rough_switches
    if not indices.size:
        return []
    # one shift for all, and the scatter of each about it is noise (`scattered`): an unknown for each would
    # make a simulation several times as long
    if indices.size > _most(record):
        logged = record.switch_half[record.logged_switches]  # what jitters is zero on average
        return [_moved_by(ALL, float(np.median(logged)))] if logged.size else []
    half, jitter = record.switch_half, record.jitter
    return [_moved_by(switch_name(int(k)), float(half[k]), float(jitter[k])) for k in indices]


def _most(record: MeasuredRecord) -> int:
    return MOST_SEPARATE if record.separate_switches else MOST_SWITCHES


def _moved_by(name: str, half: float, jitter: float = 0.0) -> Unknown:
    most = half + _WITHIN * jitter
    prior = Prior(0.0, math.hypot(half * UNIFORM, jitter))
    return Unknown(name, 0.0, -most, most, scale=most, prior=prior, unit="s")


def switch_shifts(record: MeasuredRecord, names: Sequence[str]) -> Floats:
    """(switches, names) the shift of each switch by each quantity, s per unit of it."""
    shifts = np.zeros((record.switch_times.size, len(names)))
    indices = record.rough_switches
    for column, name in enumerate(names):
        if name in LOGGER_DELAYS:
            of_kind = indices[record.switch_kinds[indices] == LOGGER_DELAYS.index(name)]
            shifts[of_kind, column] = 2.0 * record.switch_half[of_kind]
        elif name == ALL:
            shifts[record.logged_switches, column] = 1.0
        else:
            k = int(name.rsplit("_", 1)[1])
            shifts[indices[indices == k], column] = 1.0
    return shifts


def scattered(record: MeasuredRecord) -> tuple[tuple[str, ...], Floats]:
    """The switches of a record that are not unknowns, and the standard deviations of their times, s.

    If there are very many, those whose commands change most; none of streamed commands.
    """
    indices = record.rough_switches
    if indices.size <= _most(record) or record.streamed:
        return (), np.empty(0)
    # the switches that change their inputs most, in units of each input's range: these move the outputs most
    width = np.ptp(record.inputs, axis=0)
    jumps = np.abs(np.diff(record.inputs, axis=0)) / np.where(width > 0.0, width, 1.0)
    size = jumps.sum(axis=1)[indices - 1]
    chosen = np.sort(indices[np.argsort(-size, kind="stable")[:_MOST_SCATTERED]])
    return tuple(switch_name(int(k)) for k in chosen), record.switch_std[chosen]


def moved_times(record: MeasuredRecord, values: dict[str, float]) -> Floats:
    """The times at which the commands acted, for given values of the shifts: none before the first."""
    if not values:
        return record.switch_times
    moved = record.switch_times + switch_shifts(record, tuple(values)) @ np.array(list(values.values()))
    return np.maximum.accumulate(moved)
