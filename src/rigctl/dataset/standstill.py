"""Stretches in which a channel repeats one value exactly, although its noise changes it at every sample.

Let a share p of the steps between other consecutive readings be zero. A stretch of L equal readings then
begins at any of n readings with probability p^(L−1) by chance. If n p^(L−1) < `CHANCE`, it is no coincidence:
the sensor, or the logger, repeated its last value. All records of a channel count together, so that a sensor
that is stuck throughout one of them is found by the others.

Sound channels repeat values, too, and four more conditions exclude them:

- Where most steps are zero (a slow channel, a logger that repeats values) a stretch says nothing.
- A coarse converter hides noise while the quantity is in the middle of one of its steps. Let a share w of all
  steps be two or three of the converter's, there and back: a reading then leaves the middle with probability
  r = 2 (w/2)^½, and p is at least (1−r)² + r²/2. A channel with larger steps moves, and says nothing.
- Noise shows in the changes of the step: two consecutive ones have opposite signs, and are larger than the
  converter's step, in half of all cases of white noise beyond it. Where a counter moves smoothly, they keep
  their sign, or are its rounding: it has no noise that could have changed it at rest.
- A sensor may be quiet at rest and noisy in use. Its rests are of all lengths, so that a stretch must be
  `_FAR` times as long as the longest other one that is not such a stretch itself.
- A flow meter is quiet where nothing flows, a pressure transducer while the pump is off, and a saturated
  amplifier has one highest value: the smallest and the largest of all readings say nothing, nor does a value
  to which a channel returns `_RETURNS` times, as to the zero of a meter that reads both directions.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from rigctl.units import show

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigctl.dataset.run import Run

#: expected number of such stretches in a channel by chance
CHANCE: Final = 1e-6
#: largest share of equal steps of a channel whose standstill says something
_MOSTLY: Final = 0.5
#: smallest share of pairs of consecutive changes of the step that show noise, and their least size in steps
#: of the converter
_NOISY: Final = 0.25
_BEYOND_ROUNDING: Final = 1.5
#: of a coarse converter: largest share of equal steps, fewest steps of several of the converter's there and
#: back, the most that they may have, and the largest share of steps beyond that
_MOSTLY_COARSE: Final = 0.9
_FEWEST_WIDE: Final = 10
_WIDE: Final = 3.5
_MOVES: Final = 0.02
#: how many times longer than any other stretch
_FAR: Final = 3
#: fewest readings of a stretch, and fewest other ones, from which shares are known
_FEWEST: Final = 8
_FEWEST_OTHERS: Final = 30
#: equal readings from which a stretch is stored, and the most stored ones: of more, nothing stands out
_STORED: Final = 3
_MOST_STORED: Final = 200
#: so many stretches at one value are rests, to which the channel returns
_RETURNS: Final = 3
#: stretches that a remark lists
_MOST_TOLD: Final = 3


@dataclass(frozen=True, order=True)
class Standstill:
    """`readings` equal readings, from `begin` to `end`, s, of `value`, in the record at `record`."""

    readings: int
    record: int
    begin: float
    end: float
    value: float


class StandstillDetector:
    """Finds the stretches of equal readings of one channel, added record by record and piece by piece."""

    def __init__(self) -> None:
        self._record = -1
        self._open: Standstill | None = None  # the stretch that the newest reading is part of
        self._last = np.empty(0)  # the newest readings: three, for a pair of changes of the step
        self._stored: list[Standstill] = []  # a heap: the shortest first
        self._others = 0  # length of the longest stretch that was not stored for want of room
        self._readings = 0
        self._equal = 0  # steps of zero
        self._pairs = 0  # of consecutive changes of the step
        self._noisy = 0  # those that show noise
        self._step = np.inf  # of the converter: the smallest change so far
        self._wide = 0  # steps of two or three of the converter's, there and back
        self._beyond = 0  # larger steps
        self._last_change = 0.0
        self._ends = (np.inf, -np.inf)

    def begin_record(self) -> None:
        """End the present record, if there is one; what is added next belongs to the next one."""
        self._close()
        self._record += 1
        self._last = np.empty(0)

    def add(self, times: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        """Add the next readings of the record; missing ones (NaN) are left out."""
        present = np.isfinite(values)
        times, values = times[present], values[present]
        if not values.size:
            return
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):  # a file may hold any number
            self._count_steps(values)
        self._add_stretches(times, values)

    def _count_steps(self, values: NDArray[np.float64]) -> None:
        steps = np.diff(np.concatenate([self._last, values]))
        new = steps[max(self._last.size - 1, 0) :]
        self._readings += int(values.size)
        self._equal += int((new == 0.0).sum())
        self._step = min(self._step, float(np.abs(new[new != 0.0]).min(initial=np.inf)))
        self._count_wide(new[new != 0.0])
        changes = np.diff(steps)
        beyond = np.abs(changes) > _BEYOND_ROUNDING * self._step
        self._pairs += max(changes.size - 1, 0)
        self._noisy += int((beyond[1:] & beyond[:-1] & (changes[1:] * changes[:-1] < 0.0)).sum())
        self._last = np.concatenate([self._last, values])[-3:]
        self._ends = (min(self._ends[0], float(values.min())), max(self._ends[1], float(values.max())))

    def _add_stretches(self, times: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
        ends = np.append(starts[1:], values.size)
        stored = ends - starts >= _STORED
        stored[[0, -1]] = True  # they may continue in the piece before or after
        for start, end in zip(starts[stored].tolist(), ends[stored].tolist(), strict=True):
            value, begin, before = float(values[start]), float(times[start]), 0
            if start == 0 and self._open is not None and self._open.value == value:
                begin, before = self._open.begin, self._open.readings
            else:
                self._close()
            self._open = Standstill(end - start + before, self._record, begin, float(times[end - 1]), value)

    def _count_wide(self, moves: NDArray[np.float64]) -> None:
        if not moves.size:
            return
        joined = np.concatenate([[self._last_change], moves])
        larger = np.maximum(np.abs(joined[1:]), np.abs(joined[:-1]))
        several = (larger > _BEYOND_ROUNDING * self._step) & (larger < _WIDE * self._step)
        self._wide += int((several & (joined[1:] * joined[:-1] < 0.0)).sum())
        self._beyond += int((np.abs(moves) > _WIDE * self._step).sum())
        self._last_change = float(moves[-1])

    def found(self) -> list[Standstill]:
        """Return the stretches that are no coincidence, in the order in which they were added."""
        self._close()
        # From all stored stretches down to the longest alone: the most that stand out together from all
        # others.
        stretches = sorted(self._stored, reverse=True)
        for count in range(len(stretches), 0, -1):
            shorter = stretches[count].readings if count < len(stretches) else self._others
            if self._no_coincidence(stretches[:count], max(shorter, 1)):
                # a value to which a channel returns is a level of rest, as that of a dead band: no sensor
                # sticks again and again at one value among many
                often = Counter(one.value for one in stretches[:count])
                stuck = (
                    one
                    for one in stretches[:count]
                    if one.value not in self._ends and often[one.value] < _RETURNS
                )
                return sorted(stuck, key=lambda one: (one.record, one.begin))
        return []

    def _no_coincidence(self, stretches: list[Standstill], longest_other: int) -> bool:
        """Whether the noise of all other readings rules out stretches as long as the shortest of these."""
        readings = sum(one.readings for one in stretches)
        others = self._readings - readings
        shortest = stretches[-1].readings
        if shortest < max(_FEWEST, _FAR * longest_other) or others < _FEWEST_OTHERS:
            return False
        equal = self._equal - (readings - len(stretches))
        pairs = max(self._pairs - (readings - len(stretches)), 1)
        share = min((equal + 1.0) / (others + 2.0), 1.0)
        if self._noisy >= _NOISY * pairs:
            most = _MOSTLY
        else:
            if not self._coarse:
                return False
            leaves = min(2.0 * math.sqrt(0.5 * self._wide / others), 1.0)
            share, most = max(share, (1.0 - leaves) ** 2 + 0.5 * leaves**2), _MOSTLY_COARSE
        return share <= most and self._readings * share ** (shortest - 1) < CHANCE

    @property
    def _coarse(self) -> bool:
        """Whether the noise spans a few of the converter's steps, and nothing else moves the channel."""
        return self._wide >= _FEWEST_WIDE and self._beyond <= _MOVES * self._readings

    def _close(self) -> None:
        if self._open is not None and self._open.readings >= _STORED:
            heapq.heappush(self._stored, self._open)
            if len(self._stored) > _MOST_STORED:
                self._others = max(self._others, heapq.heappop(self._stored).readings)
        self._open = None


def standstill_remark(
    name: str, stretches: Sequence[Standstill], show: Callable[[float], str], where: Sequence[str]
) -> str:
    """Return a sentence, without an end, on the stretches of a channel in which it repeats one value.

    Parameters
    ----------
    show: a reading, SI, with its unit.
    where: each record: `` in record 3``; "" if there is no other.
    """
    first, *others = [
        f"{show(one.value)}, from {one.begin:.6g} s to {one.end:.6g} s{where[one.record]} "
        f"({one.readings} readings)"
        for one in stretches[:_MOST_TOLD]
    ]
    more = len(stretches) - _MOST_TOLD
    listed = "; ".join((first, *others, *([f"and in {more} more stretches"] if more > 0 else [])))
    return f"{name} repeats one value exactly, {listed}, which its noise does not allow"


def find_standstills(
    records: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> list[Standstill]:
    """Return the stretches of equal readings of a channel that are no coincidence.

    Parameters
    ----------
    records: times, s, and readings of each record; `Standstill.record` is the position among these.
    """
    detector = StandstillDetector()
    for times, values in records:
        detector.begin_record()
        detector.add(times, values)
    return detector.found()


def stuck_channels(run: Run) -> list[str]:
    """Return a sentence for each channel that repeats one value although it has noise; times are the run's.

    Only records count: between them a bench is sampled at another rate.
    """
    if not run.info["rows"] or not run.info["records"]:
        return []
    layout = run.layout
    detectors = {name: StandstillDetector() for name in layout.channels}
    for record in run.each(range(int(run.info["records"]))):
        for name, detector in detectors.items():
            detector.begin_record()
            detector.add(record.time, record.channels[name])
    where = [f" in record {index}" for index in range(int(run.info["records"]))]
    remarks = []
    for name, detector in detectors.items():
        if stretches := detector.found():
            shown = partial(show, unit=layout.unit(name), difference=name in layout.differences)
            remark = standstill_remark(name, stretches, shown, where)
            remarks.append(f"{remark}: was the sensor stuck?")
    return remarks
