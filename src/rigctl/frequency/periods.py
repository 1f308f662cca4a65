"""Whole periods of a periodic excitation, and the exact spectra of each.

The response of a linear system to a periodic input has, once it has settled, lines at multiples of 1/period
alone. Over one period these are found without leakage: of a command by the integral of its constant pieces,

    U_n = 2/T sum_j u_j int exp(-2 pi i n t/T) dt,

of samples by least squares with a straight line beside them, which also needs no equal distances. Where lines
have to be left out, the straight line would take their part: its slope is then that of the periods' means.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.frequency.signals import Floats, Held, Signals

Complex = NDArray[np.complex128]

#: squared difference from one period to the next, as a share of the variance, up to which a signal repeats
_SAME: Final = 0.02
#: the same up to which a lag is tried, how many are, and the difference up to which a sample may be the same
_NEAR, _TRIED, _NEARLY = 0.6, 40, 0.3
#: most samples by which the length of a period is refined
_REFINED: Final = 5000
#: fewest samples of a period, and share of the record that its periods have to fill
_FEWEST, _FILLED = 8, 0.5
#: with at least so many periods the first is left out, in which the response settles
_SETTLING: Final = 3
#: lines weaker than this share of the strongest amplitude are not fitted; rows that are needed for an unknown
_WEAK, _ROWS = 1e-3, 1.2
#: most lines that are fitted, the strongest; and difference of times, in periods, up to which they are alike
_MOST_LINES, _ALIKE = 400, 1e-7
#: most of rows times squared lines, the work of a fit; and rows that are worked on at once
_WORK, _PIECE = 2e10, 4096
#: longest record whose periods are looked for, in intervals per sample: the rest of it is gaps
_SPARSE: Final = 8
#: share by which the diagonal of the equations is raised, so that missing samples leave them solvable
_RIDGE: Final = 1e-12
#: share of half the sampling rate up to which lines are fitted
_BELOW_NYQUIST: Final = 0.95


@dataclass(frozen=True)
class Periods:
    """Whole periods of a record: their `length`, s, and the `starts` of those that are used."""

    length: float
    starts: tuple[float, ...]
    settling: int  #: periods before, which are left out


def find_periods(signals: Signals) -> Periods | None:
    """The periods of a record whose inputs repeat; None if they do not, or fill less than half of it."""
    step = signals.interval
    if signals.times[-1] - signals.times[0] > _SPARSE * signals.times.size * step:
        return None
    even = np.arange(signals.times[0], signals.times[-1] + 0.5 * step, step)
    values = _normal(signals, even)
    for lag in _lags(values):
        apart = ((values[lag:] - values[:-lag]) ** 2).mean(axis=1)
        if np.mean(apart < _NEARLY) < _FILLED / 2.0:
            continue  # the rest takes longer, and most lags are none
        length = _exact(signals, lag * step, even)
        first, last = _repeating(signals, even, length)
        # whole periods, counted from the end: what comes before them is settling
        count = int((last - first + min(3.0 * step, 0.1 * length)) / length)
        if count >= 2 and count * length >= _FILLED * (even[-1] - even[0]):
            settling = 1 if count >= _SETTLING else 0
            starts = tuple(last - length * (count - k) for k in range(settling, count))
            return Periods(length, starts, settling)
    return None


def _normal(signals: Signals, times: Floats) -> Floats:
    """(n, i) the inputs at these times, of mean 0 and variance 1."""
    values = np.column_stack([signals.input_values(k, times) for k in range(len(signals.inputs))])
    spread = values.std(axis=0)
    return np.asarray((values - values.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0))


def _lags(values: Floats) -> list[int]:
    """The lags, in samples, after which a signal comes near to repeating itself, the shortest first."""
    count = values.shape[0]
    lags = np.arange(count // 2 + 1)
    size = 1 << int(2 * count - 1).bit_length()
    products = np.fft.irfft(np.abs(np.fft.rfft(values, size, axis=0)) ** 2, size, axis=0)[lags].sum(axis=1)
    energy = np.concatenate(([0.0], np.cumsum((values**2).sum(axis=1))))
    squares = energy[count - lags] + energy[count] - energy[lags]
    total = np.vstack([np.zeros(values.shape[1]), np.cumsum(values, axis=0)])
    means = (total[count - lags] ** 2 + (total[count] - total[lags]) ** 2).sum(axis=1) / (count - lags)
    # the squared difference of two uncorrelated stretches is the sum of their variances
    ratio = np.maximum(squares - 2.0 * products, 0.0) / np.maximum(squares - means, 1e-12 * count)
    within = ratio[_FEWEST:]
    dips = (within[1:-1] <= within[:-2]) & (within[1:-1] <= within[2:]) & (within[1:-1] < _NEAR)
    return [int(lag) for lag in (np.flatnonzero(dips) + _FEWEST + 1)[:_TRIED]]


def _exact(signals: Signals, near: float, times: Floats) -> float:
    """The period near `near`, s: from the changes of a command, or where the samples repeat best."""
    command = signals.inputs[0]
    if isinstance(command, Held):
        changed = np.flatnonzero(np.diff(command.values)) + 1
        at, before, after = command.times[changed], command.values[changed - 1], command.values[changed]
        later = np.searchsorted(at, at + near - signals.interval)
        later = later[later < at.size]
        apart = at[later] - at[: later.size]
        # the same change, from the same value to the same one
        same = (after[later] == after[: later.size]) & (before[later] == before[: later.size])
        same &= apart <= near + signals.interval
        if 2 * same.sum() > later.size:
            return float(np.median(apart[same]))
    tried = near + signals.interval * np.linspace(-1.0, 1.0, 81)
    inside = times[times < times[-1] - tried[-1]]
    inside = inside[:: max(inside.size // _REFINED, 1)]
    here = signals.input_values(0, inside)
    squares = [float(((signals.input_values(0, inside + one) - here) ** 2).sum()) for one in tried]
    return float(tried[int(np.argmin(squares))])


def _repeating(signals: Signals, even: Floats, length: float) -> tuple[float, float]:
    """Start and end of the stretch that repeats itself after `length`, s: of several, that with the most
    variance."""
    begins = np.append(even[even < even[-1] - length], even[-1] - length)
    here, later = np.split(_normal(signals, np.concatenate([begins, begins + length])), 2)
    apart = ((later - here) ** 2).sum(axis=1) / here.shape[1]
    # a jump belongs to one interval or the next: single samples may differ by any amount
    means = _running_means(apart, max(round(length / signals.interval / 16.0), 1))
    same = np.concatenate(([False], (means < 4.0 * _SAME) | (apart < _SAME), [False]))
    edges = np.flatnonzero(np.diff(same.astype(int)))
    best, most = (0.0, 0.0), 0.0
    for first, beyond in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        energy = float(here[first:beyond].var(axis=0).sum()) * (beyond - first)
        if energy > most:
            best, most = (float(begins[first]), float(begins[beyond - 1]) + length), energy
    return best


def _running_means(values: Floats, beside: int) -> Floats:
    """(n) the mean of each value and of so many on both sides."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    at = np.arange(values.size)
    first, beyond = np.maximum(at - beside, 0), np.minimum(at + beside + 1, values.size)
    return np.asarray((total[beyond] - total[first]) / (beyond - first))


@dataclass(frozen=True)
class Lines:
    """Amplitudes of each segment: inputs (segments, lines, i), outputs (segments, lines, m).

    `images` (segments, lines, 2) are those of the first input at a sampling rate above and below each line,
    which samples of the output do not tell from it; 0 of a measured input. `left_out` lines are not fitted.
    """

    frequencies: Floats
    inputs: Complex
    outputs: Complex
    images: Complex
    left_out: int = 0


def period_lines(signals: Sequence[Signals], periods: Sequence[Periods]) -> Lines:
    """The lines at the multiples of 1/period that the inputs contain, in every period of all records."""
    length = float(np.mean([one.length for one in periods]))
    chosen, left_out = _excited(signals, periods, length)
    solver = _Solver(length, chosen, straight=not left_out)
    inputs, outputs, images = [], [], []
    for one, each in zip(signals, periods, strict=True):
        found = solver.settled(one.times, one.outputs, each.starts)
        given = [_of_input(one, k, each.starts, solver) for k in range(len(one.inputs))]
        for number, start in enumerate(each.starts):
            amplitudes = found[number]
            if amplitudes is None:
                continue
            outputs.append(amplitudes)
            inputs.append(np.stack([of_one[number] for of_one in given], axis=-1))
            images.append(_images(one, start, solver))
    if not outputs:
        empty = np.empty((0, chosen.size, 1), dtype=np.complex128)
        return Lines(chosen, empty, empty, empty)
    return Lines(chosen, np.stack(inputs), np.stack(outputs), np.stack(images), left_out)


def _excited(signals: Sequence[Signals], periods: Sequence[Periods], length: float) -> tuple[Floats, int]:
    """The frequencies that the inputs contain in a period of each record, of too many the strongest; and how
    many are left out."""
    nyquist = 0.5 / max(one.interval for one in signals)
    rows = min(int(length / one.interval) for one in signals)
    count = max(int(_BELOW_NYQUIST * nyquist * length), 1)
    energy = np.zeros((count, len(signals[0].inputs)))
    for one, each in zip(signals, periods, strict=True):
        times = each.starts[-1] + length * (np.arange(rows) + 0.5) / rows
        values = np.column_stack([one.input_values(k, times) for k in range(len(one.inputs))])
        energy += np.abs(np.fft.rfft(values, axis=0)[1 : count + 1]) ** 2
    kept = np.flatnonzero((energy >= _WEAK**2 * energy.max(axis=0)).any(axis=1))
    most = max(min(int(rows / (2.0 * _ROWS)) - 1, int((_WORK / rows) ** 0.5), _MOST_LINES), 1)
    left_out = max(kept.size - most, 0)
    if left_out:
        kept = np.sort(kept[np.argsort(-energy[kept].max(axis=1))[:most]])
    return np.asarray((kept + 1.0) / length, dtype=np.float64), left_out


class _Solver:
    """Fits lines to the samples of a period; periods that are sampled alike share the equations."""

    def __init__(self, length: float, frequencies: Floats, *, straight: bool) -> None:
        self.length, self.frequencies, self.straight = length, frequencies, straight
        self._since: Floats = np.empty(0)
        self._equations: Floats = np.empty((0, 0))

    def settled(self, times: Floats, values: Floats, starts: Sequence[float]) -> list[Complex | None]:
        """(lines, m) amplitudes of samples (n, m) in each period of a record, without its drift; None if too
        many samples are missing."""
        each = [self._fitted(times, values, start) for start in starts]
        known = [k for k, one in enumerate(each) if one is not None]
        if self.straight or len(known) < 2:
            return [None if one is None else one[0][:, :-1] for one in each]
        means = np.array([one[1][:-1] for one in each if one is not None])
        slopes = dict(zip(known, np.gradient(means, np.asarray(starts)[known], axis=0), strict=True))
        # the last column is what a slope of 1 looks like
        return [
            None if one is None else one[0][:, :-1] - one[0][:, -1:] * slopes[k] for k, one in enumerate(each)
        ]

    def _fitted(self, times: Floats, values: Floats, start: float) -> tuple[Complex, Floats] | None:
        """Amplitudes (lines, m + 1) and means (m + 1) of samples in one period, and of a rising line."""
        inside = (times >= start) & (times < start + self.length) & np.isfinite(values).all(axis=1)
        since = times[inside] - start
        count = self.frequencies.size
        unknowns = 2 * count + 1 + self.straight
        if since.size <= unknowns:
            return None
        known = since.size == self._since.size and np.allclose(since, self._since, 0.0, _ALIKE * self.length)
        seen = np.column_stack([values[inside], since - 0.5 * self.length])
        equations, right = np.zeros((unknowns, unknowns)), np.zeros((unknowns, seen.shape[1]))
        for piece, design in self._designs(since):
            right += design.T @ seen[piece]
            if not known:
                equations += design.T @ design
        if not known:
            # nearly orthogonal columns: the normal equations are well conditioned, and faster for many lines
            equations[np.diag_indices_from(equations)] *= 1.0 + _RIDGE
            self._since, self._equations = since, equations
        found = np.linalg.solve(self._equations, right)
        return found[:count] + 1j * found[count : 2 * count], found[2 * count]

    def _designs(self, since: Floats) -> Iterator[tuple[slice, Floats]]:
        """Rows of the equations, piece by piece: those of a long period need gigabytes."""
        for begin in range(0, since.size, _PIECE):
            times = since[begin : begin + _PIECE]
            angle = 2.0 * np.pi * np.outer(times, self.frequencies)
            line = np.column_stack([np.ones(times.size), times / self.length])[:, : 1 + self.straight]
            yield slice(begin, begin + _PIECE), np.hstack([np.cos(angle), -np.sin(angle), line])


def _of_input(signals: Signals, index: int, starts: Sequence[float], solver: _Solver) -> list[Complex]:
    """(lines) amplitudes of one input in each period."""
    values = signals.inputs[index]
    if isinstance(values, Held):
        return [_integral(values, start, solver.length, solver.frequencies) for start in starts]
    none = np.zeros(solver.frequencies.size, dtype=np.complex128)
    found = solver.settled(signals.times, values[:, None], starts)
    return [none if one is None else one[:, 0] for one in found]


def _images(signals: Signals, start: float, solver: _Solver) -> Complex:
    """(lines, 2) amplitudes of the first input that the samples in a period show as those of the lines."""
    values = signals.inputs[0]
    if not isinstance(values, Held):
        return np.zeros((solver.frequencies.size, 2), dtype=np.complex128)
    rate = 1.0 / signals.interval
    since = float(signals.times[np.searchsorted(signals.times, start)]) - start
    both = [
        # as of the first sample: only there the phases of a line and its image are the same
        _integral(values, start, solver.length, solver.frequencies + one) * np.exp(2j * np.pi * one * since)
        for one in (rate, -rate)
    ]
    return np.stack(both, axis=-1)


def _integral(command: Held, start: float, length: float, frequencies: Floats) -> Complex:
    """(lines) amplitudes of a command in one period."""
    edges, levels = command.between(start, start + length)
    steps = np.diff(levels, append=levels[0])
    ends = edges[1:] - start
    # integrated by parts: each step of the command contributes at its own time, the last at the end
    total = np.zeros(frequencies.size, dtype=np.complex128)
    for begin in range(0, ends.size, _PIECE):
        piece = slice(begin, begin + _PIECE)
        total += np.exp(-2j * np.pi * np.outer(frequencies, ends[piece])) @ steps[piece]
    return np.asarray(total / (1j * np.pi * frequencies * length))
