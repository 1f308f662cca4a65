"""Signals whose spectra are estimated: commands that hold, and samples at nearly equal distances.

A command changes at any time. By its values at the samples it would be late, and its frequencies beyond half
the sampling rate would fold onto those below: it is given by means over fine parts of the sampling interval.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]

#: intervals between samples longer than this, in medians, are gaps
_GAP: Final = 1.5
#: scatter of the intervals, in medians, up to which samples are taken for evenly spaced
_UNEVEN: Final = 0.25
#: most missing samples in a row that are interpolated
_BRIDGED: Final = 3
#: parts of a sampling interval over each of which a command is averaged
FINE: Final = 8


@dataclass(frozen=True)
class Held:
    """A command: `values` (k) from each of the `times` (k), s, until the next; before them the first."""

    times: Floats
    values: Floats

    @cached_property
    def _integral(self) -> Floats:
        steps = self.values[:-1] * np.diff(self.times)
        return np.concatenate(([0.0], np.cumsum(steps)))

    def _until(self, times: Floats) -> Floats:
        """The integral from the first change, at any times."""
        at = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, self.times.size - 1)
        return np.asarray(self._integral[at] + self.values[at] * (times - self.times[at]))

    def means(self, times: Floats, width: float) -> Floats:
        """The means over `width` s around each time."""
        return (self._until(times + 0.5 * width) - self._until(times - 0.5 * width)) / width

    def between(self, start: float, end: float) -> tuple[Floats, Floats]:
        """Edges (k + 1) and values (k) of its constant pieces from `start` to `end`."""
        inside = self.times[(self.times > start) & (self.times < end)]
        edges = np.concatenate(([start], inside, [end]))
        at = np.searchsorted(self.times, edges[:-1], side="right") - 1
        return edges, self.values[np.maximum(at, 0)]


@dataclass(frozen=True)
class Signals:
    """One record.

    Attributes
    ----------
    times: (n) of the samples, s, increasing.
    inputs: each a command, or (n) values at the samples; the first is the one whose effect is asked for.
    outputs: (n, m) values at the samples; NaN in any column leaves a sample out of all.
    """

    times: Floats
    inputs: tuple[Held | Floats, ...]
    outputs: Floats

    @cached_property
    def interval(self) -> float:
        """The median distance of two samples, s."""
        return float(np.median(np.diff(self.times)))

    @property
    def uneven(self) -> bool:
        """Whether samples without gaps between them are too unevenly spaced for a spectrum."""
        steps = np.diff(self.times) / self.interval
        return bool(np.std(steps[steps < _GAP]) > _UNEVEN)

    def input_values(self, index: int, times: Floats) -> Floats:
        """An input at any times; a command as the mean over a sampling interval."""
        values = self.inputs[index]
        if isinstance(values, Held):
            return values.means(times, self.interval)
        return np.interp(times, self.times, values)


@dataclass(frozen=True)
class Stretch:
    """Samples at equal distances without a gap: times (n), outputs (n, m).

    An input is (n, `FINE`), the means of a command in the parts of the interval after each sample, or (n, 1),
    values at the samples.
    """

    times: Floats
    inputs: tuple[Floats, ...]
    outputs: Floats


def stretches(signals: Signals, interval: float) -> list[Stretch]:
    """The parts of a record without gaps, at equal distances near `interval`, s.

    Up to three missing samples are interpolated. Times that scatter a little are made equal by linear
    interpolation, which changes evenly spaced samples by nothing.
    """
    good = np.isfinite(signals.outputs).all(axis=1)
    times, outputs = signals.times[good], signals.outputs[good]
    if times.size < 2:
        return []
    gaps = np.flatnonzero(np.diff(times) > (_BRIDGED + _GAP) * interval) + 1
    found = []
    for inside in np.split(np.arange(times.size), gaps):
        if inside.size < 2:
            continue
        first, last = float(times[inside[0]]), float(times[inside[-1]])
        even = np.linspace(first, last, max(round((last - first) / interval), 1) + 1)
        columns = [np.interp(even, times[inside], outputs[inside, k]) for k in range(outputs.shape[1])]
        step = (last - first) / (even.size - 1)
        inputs = tuple(_fine(signals, k, even, step) for k in range(len(signals.inputs)))
        found.append(Stretch(even, inputs, np.column_stack(columns)))
    return found


def _fine(signals: Signals, index: int, times: Floats, step: float) -> Floats:
    """An input of a stretch."""
    values = signals.inputs[index]
    if not isinstance(values, Held):
        return signals.input_values(index, times)[:, None]
    middles = times[:, None] + step * (np.arange(FINE) + 0.5) / FINE
    return values.means(middles.ravel(), step / FINE).reshape(middles.shape)
