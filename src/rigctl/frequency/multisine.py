"""A multisine of low crest factor: harmonics of one period with equal amplitudes and chosen phases.

    x(t) = sqrt(2/K) sum_k cos(2 pi n_k t / T + phi_k),    k = 1 … K,    rms 1

Its crest factor is ``max |x|``. Schroeder's phases keep it low for neighbouring harmonics; clipping the
signal, and keeping the phases of what results, lowers it further.

References: M. R. Schroeder, "Synthesis of low-peak-factor signals and binary sequences with low
autocorrelation", IEEE Trans. Inf. Theory 16 (1970); E. Van der Ouderaa, J. Schoukens, J. Renneboog,
"Peak factor minimization using a time-frequency domain swapping algorithm", IEEE Trans. Instrum. Meas. 37
(1988).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: rounds of clipping, and the share of the peak at which they begin and end
_ROUNDS: Final = 120
_CLIPPED: Final = (0.75, 0.98)
#: random starts, and the size of a transform up to which they are tried
_STARTS: Final = 5
_SMALL: Final = 1 << 14
#: points per period of the highest harmonic; a peak between two of them is higher by less than 0.4 %
_POINTS: Final = 32
#: decimals of a phase, rad: the last digits of a transform differ between computers
_DECIMALS: Final = 6


@dataclass(frozen=True)
class Phases:
    """Phases of cosines, rad, and the crest factor (peak over rms) that they give."""

    values: tuple[float, ...]
    crest_factor: float


def low_crest_phases(harmonics: Sequence[int], seed: int | None = None) -> Phases:
    """Phases for equal amplitudes at these harmonics of one period, increasing and from 1 on.

    Parameters
    ----------
    seed: start from random phases; by default the best of Schroeder's and of some random ones is returned,
        since his are good for neighbouring harmonics only. The result depends on nothing else.
    """
    return _low_crest(tuple(harmonics), seed)


@lru_cache(maxsize=64)
def _low_crest(harmonics: tuple[int, ...], seed: int | None) -> Phases:
    """Kept, since planning, preview and run ask for the same, and thousands of harmonics take seconds."""
    orders = np.asarray(harmonics)
    size = 1 << int(_POINTS * orders[-1] - 1).bit_length()
    if seed is not None:
        starts = [_random(orders.size, seed)]
    else:
        starts = [-np.pi * np.arange(orders.size) * np.arange(1, orders.size + 1) / orders.size]
        starts += [_random(orders.size, number) for number in range(_STARTS if size <= _SMALL else 0)]
    best = min((_clipped(orders, start, size) for start in starts), key=lambda one: one[1])
    values = np.asarray(np.round(np.mod(best[0], 2.0 * np.pi), _DECIMALS), dtype=np.float64)
    crest = float(np.abs(_course(orders, values, size)).max())
    return Phases(tuple(values.tolist()), crest)


def _random(count: int, seed: int) -> Floats:
    return np.random.Generator(np.random.PCG64(seed)).uniform(-np.pi, np.pi, count)


def _clipped(orders: NDArray[np.int_], phases: Floats, size: int) -> tuple[Floats, float]:
    """The phases with the lowest peak of all rounds, and that peak."""
    best, lowest = phases, np.inf
    for share in np.linspace(*_CLIPPED, _ROUNDS):
        course = _course(orders, phases, size)
        peak = float(np.abs(course).max())
        if peak < lowest:
            best, lowest = phases, peak
        clipped = np.clip(course, -share * peak, share * peak)
        phases = np.angle(np.fft.rfft(clipped)[orders])
    return best, lowest


def _course(orders: NDArray[np.int_], phases: Floats, size: int) -> Floats:
    """(size) one period, of rms 1."""
    spectrum = np.zeros(size // 2 + 1, dtype=np.complex128)
    spectrum[orders] = size * np.exp(1j * phases) / np.sqrt(2.0 * orders.size)
    return np.fft.irfft(spectrum, size)
