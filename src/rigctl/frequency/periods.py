"""Whole periods of a periodic excitation, and the exact spectra of each.

The response of a linear system to a periodic input has, once it has settled, lines at multiples of 1/period
alone. Over one period these are found without leakage: of a command by the integral of its constant pieces,

    U_n = 2/T sum_j u_j int exp(-2 pi i n t/T) dt,

of samples by least squares with a straight line beside them, which also needs no equal distances.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    """Amplitudes of each period: inputs (periods, lines, i), outputs (periods, lines, m)."""

    frequencies: Floats
    inputs: Complex
    outputs: Complex


def period_lines(signals: Sequence[Signals], periods: Sequence[Periods]) -> Lines:
    """The lines at the multiples of 1/period that the inputs contain, in every period of all records."""
    length = float(np.mean([one.length for one in periods]))
    chosen = _excited(signals, periods, length)
    every = [(one, start) for one, each in zip(signals, periods, strict=True) for start in each.starts]
    solver = _Solver(length, chosen)
    outputs = [solver.fitted(one.times, one.outputs, start) for one, start in every]
    known = [k for k, one in enumerate(outputs) if one is not None]
    inputs = [
        np.stack([_of_input(one, k, start, solver) for k in range(len(one.inputs))], axis=-1)
        for one, start in (every[k] for k in known)
    ]
    if not known:
        empty = np.empty((0, chosen.size, 1), dtype=np.complex128)
        return Lines(chosen, empty, empty)
    return Lines(chosen, np.stack(inputs), np.stack([one for one in outputs if one is not None]))


def _excited(signals: Sequence[Signals], periods: Sequence[Periods], length: float) -> Floats:
    """The frequencies that the inputs contain in a period of each record, of too many the strongest."""
    nyquist = 0.5 / max(one.interval for one in signals)
    rows = min(int(length / one.interval) for one in signals)
    count = max(int(_BELOW_NYQUIST * nyquist * length), 1)
    energy = np.zeros((count, len(signals[0].inputs)))
    for one, each in zip(signals, periods, strict=True):
        times = each.starts[-1] + length * (np.arange(rows) + 0.5) / rows
        values = np.column_stack([one.input_values(k, times) for k in range(len(one.inputs))])
        energy += np.abs(np.fft.rfft(values, axis=0)[1 : count + 1]) ** 2
    kept = np.flatnonzero((energy >= _WEAK**2 * energy.max(axis=0)).any(axis=1))
    most = max(min(int(rows / (2.0 * _ROWS)) - 1, _MOST_LINES), 1)
    if kept.size > most:
        kept = np.sort(kept[np.argsort(-energy[kept].max(axis=1))[:most]])
    return np.asarray((kept + 1.0) / length, dtype=np.float64)


class _Solver:
    """Fits lines to the samples of a period; periods that are sampled alike share the equations."""

    def __init__(self, length: float, frequencies: Floats) -> None:
        self.length, self.frequencies = length, frequencies
        self._since: Floats = np.empty(0)
        self._solve: Floats = np.empty((0, 0))

    def fitted(self, times: Floats, values: Floats, start: float) -> Complex | None:
        """(lines, m) amplitudes of samples (n, m) in one period; None if too many are missing."""
        inside = (times >= start) & (times < start + self.length) & np.isfinite(values).all(axis=1)
        since = times[inside] - start
        count = self.frequencies.size
        if since.size < 2 * count + 2:
            return None
        if since.size != self._since.size or not np.allclose(since, self._since, 0.0, _ALIKE * self.length):
            self._since, self._solve = since, self._equations(since)
        found = self._solve @ values[inside]
        return np.asarray(found[:count] + 1j * found[count : 2 * count])

    def _equations(self, since: Floats) -> Floats:
        """(unknowns, n) what makes amplitudes of samples."""
        angle = 2.0 * np.pi * np.outer(since, self.frequencies)
        ones = np.ones((since.size, 1))
        design = np.hstack([np.cos(angle), -np.sin(angle), ones, since[:, None] / self.length])
        # nearly orthogonal columns: the normal equations are well conditioned, and faster for many lines
        equations = design.T @ design
        equations[np.diag_indices_from(equations)] *= 1.0 + _RIDGE
        return np.asarray(np.linalg.solve(equations, design.T))


def _of_input(signals: Signals, index: int, start: float, solver: _Solver) -> Complex:
    """(lines) amplitudes of one input in one period."""
    values, frequencies = signals.inputs[index], solver.frequencies
    if not isinstance(values, Held):
        found = solver.fitted(signals.times, values[:, None], start)
        return np.zeros(frequencies.size, dtype=np.complex128) if found is None else found[:, 0]
    edges, levels = values.between(start, start + solver.length)
    steps = np.diff(levels, append=levels[0])
    # integrated by parts: each step of the command contributes at its own time, the last at the end
    turned = np.exp(-2j * np.pi * np.outer(frequencies, edges[1:] - start))
    return np.asarray((turned @ steps) / (1j * np.pi * frequencies * solver.length))
