"""Simulated outputs as they were read by the clock of a device that is off against that of the commands.

A clock that is behind by τ gives the time t to a reading at t + τ. The reading of an output is then
``r(t) = y(t + τ)``, for which the record is integrated to these times: exact whatever τ is, with the
derivatives by the other unknowns at the same times. That by τ is ``(y(t + τ + δ) − y(t + τ − δ))/2δ``, of an
integration with tight tolerance: off by ``δ²·y'''/6``, δ a tenth of the clock's standard deviation. What
was before a record is not known: there y is that at its start, and no such reading counts within the largest
offset, twice what is stated, of either end (`rigctl.model.measured.clocks`). Of a measured input
``u(s) = r(s − τ)``: the times of its readings are moved, and it is constant beyond the first and the last
one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.excitation import Ramps
from rigctl.engine.trajectories import OfEachRecord, Trajectories
from rigctl.model.measured.offsets import moved_lines
from rigctl.model.measured.record import MeasuredRecord
from rigctl.model.reading_errors import ClockError

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]

#: half the distance of the times between which the derivative by a clock's offset is taken, in standard
#: deviations of its prior
STEP = 0.1


@dataclass(frozen=True)
class ReadTimes:
    """The times to which a record is integrated, and where each output was read.

    Attributes
    ----------
    every: (k) increasing.
    at: (n, outputs) the index among `every` of each reading.
    """

    every: Floats
    at: Integers

    def of(self, outputs: Floats) -> Floats:
        """(n, outputs, …) the readings of outputs, or derivatives, at `every` time; without those that an
        integration that failed has not reached."""
        reached = np.cumprod(np.all(self.at < len(outputs), axis=1)).astype(bool)
        return np.asarray(outputs[self.at[reached], np.arange(self.at.shape[1])])


def read_times(record: MeasuredRecord, names: Sequence[str], offsets: Mapping[str, float]) -> ReadTimes:
    """When the outputs `names` were read; `offsets` by channel, s."""
    late = np.array([offsets.get(name, 0.0) for name in names])
    # one integration for all outputs: to every time at which any of them was read. Before the first command
    # nothing is known, so the state is that at the start
    wanted = np.maximum(record.times[:, None] + late, record.switch_times[0])
    every, at = np.unique(wanted, return_inverse=True)
    return ReadTimes(every, at.reshape(wanted.shape))


def moved_ramps(record: MeasuredRecord, inputs: Sequence[str], offsets: Mapping[str, float]) -> Ramps | None:
    """The inputs that change continuously, as they were at the times of the commands' clock."""
    late = [offsets.get(inputs[index], 0.0) for index in record.along]
    if record.ramps is None or not any(late):
        return record.ramps
    return Ramps(np.array(record.along), *moved_lines(record.knots, record.lines, late))


def as_dated(
    simulated: Trajectories,
    records: Sequence[MeasuredRecord],
    times: Sequence[ReadTimes],
    clocks: Sequence[ClockError],
    difference: Callable[[int, ClockError], Floats],
) -> Trajectories:
    """The outputs at the times at which they were read, instead of all those to which they were integrated.

    States are those at the first output's times.

    Parameters
    ----------
    records, times: of each trajectory.
    clocks: by whose offsets derivatives are added, after the simulated ones.
    difference: (n, outputs) the derivative of a trajectory's outputs by a clock's offset.
    """
    outputs = tuple(one.of(array) for one, array in zip(times, simulated.outputs, strict=True))
    states = tuple(
        array[one.at[: len(read), 0]]
        for one, array, read in zip(times, simulated.states, outputs, strict=True)
    )
    return replace(
        simulated,
        times=tuple(record.times[: len(read)] for record, read in zip(records, outputs, strict=True)),
        states=states,
        outputs=outputs,
        sensitivities=_DatedDerivatives(simulated, records, times, clocks, difference),
        columns=(*simulated.columns, *(one.name for one in clocks)),
    )


class _DatedDerivatives(OfEachRecord):
    """The derivatives of each record's readings; those by offsets are computed when one is first used."""

    def __init__(
        self,
        simulated: Trajectories,
        records: Sequence[MeasuredRecord],
        times: Sequence[ReadTimes],
        clocks: Sequence[ClockError],
        difference: Callable[[int, ClockError], Floats],
    ) -> None:
        self._slopes, self._records, self._times = simulated.sensitivities, records, times
        self._clocks, self._difference = clocks, difference
        self._known: dict[int, Floats] = {}

    def __len__(self) -> int:
        return len(self._records)

    def of(self, record: int) -> Floats:
        """At the times of its readings."""
        if record not in self._known:
            self._known[record] = self._read(record)
        return self._known[record]

    def _read(self, index: int) -> Floats:
        # the columns of the equations at each reading's own time, then those by the offsets, zero for a clock
        # under which this run was not recorded
        slopes = self._times[index].of(self._slopes[index])
        run = self._records[index].run
        added = [
            self._difference(index, one)[: len(slopes)] if one.acts_in(run) else np.zeros(slopes.shape[:2])
            for one in self._clocks
        ]
        return np.concatenate([slopes, *(one[:, :, None] for one in added)], axis=2) if added else slopes
