"""The amplitude at which a hidden effect has a given size in the data.

The size λ of an effect is ‖(I − P_J)·W·(y_with − y_without)‖ of noise-free outputs, in sigmas: what remains
of it after a fit of the model under test. W and J belong to that model, so λ is computed by a callable; it is
nearly proportional to the amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl_validation.bench.campaign import Campaign, clean_outputs
from rigctl_validation.bench.record import BenchFailure
from rigctl_validation.hidden_effect import HiddenEffect, Shape, hide

#: time [s] and channels [SI] of every record, without noise
Clean: TypeAlias = list[tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]]
#: λ of the difference between a campaign with an effect and the one without
SizeOf: TypeAlias = Callable[[Clean, Clean], float]

#: relative accuracy with which λ must be reached
CLOSE = 0.05
_MOST_TRIALS = 14
#: largest change of the amplitude from one trial to the next
_LEAP = 30.0
#: λ below which a trial gives no information for the next one
_NOTHING = 1e-6


@dataclass(frozen=True)
class Amplitude:
    """An amplitude [SI] and its size λ; `reached` is False if no amplitude has the wanted size."""

    value: float
    size: float
    reached: bool


@dataclass
class Amplitudes:
    """Finds amplitudes, and caches what it has tried.

    Parameters
    ----------
    size_of: λ of two campaigns, for one noise and one kind of campaign.
    """

    size_of: SizeOf
    _tried: dict[object, list[tuple[float, float]]] = field(default_factory=dict)

    def find(
        self, hidden: HiddenEffect, wanted: float, plain: Campaign, *, shape: Shape = "other", sign: int = 1
    ) -> Amplitude:
        """The amplitude, with the sign of the direction, that has the size `wanted` on the bench of `plain`.

        Noise, scatter and seed of `plain` are ignored. If λ cannot be reached within physical limits, the
        largest found is returned as not reached.
        """
        steady = replace(plain, seed=0)
        key = (hidden.effect, shape, sign, plain.chamber_pressures, plain.repeated)
        points = (tuple(plain.temperatures), tuple(plain.pressures), plain.bench)
        tried = self._tried.setdefault((key, points), [])

        def size(amplitude: float) -> float:
            with_it = hide(steady, [(hidden, sign * amplitude)], shape)
            try:
                actual = float(self.size_of(clean_outputs(with_it), clean_outputs(steady)))
            except BenchFailure:
                actual = math.inf
            tried.append((amplitude, actual))
            return actual

        amplitude, actual = search_amplitude(size, wanted, abs(hidden.typical), hidden.largest, tried)
        reached = abs(actual / wanted - 1.0) <= CLOSE
        return Amplitude(sign * amplitude, actual, reached)


def search_amplitude(
    size: Callable[[float], float],
    wanted: float,
    typical: float,
    largest: float,
    tried: list[tuple[float, float]],
) -> tuple[float, float]:
    """The amplitude whose size is nearest to the wanted one, and that size.

    Secant method on the logarithms, bracketed by what is known to be too small and too large.

    Parameters
    ----------
    size: of an amplitude; its results are appended to `tried`.
    typical, largest: amplitudes at which the search starts, and ends.
    """
    if not tried:
        size(min(typical, largest))
    for _ in range(_MOST_TRIALS):
        _, nearest = _nearest(tried, wanted)
        if abs(nearest / wanted - 1.0) <= CLOSE:
            break
        low = max((a for a, s in tried if s < wanted), default=0.0)
        high = min((a for a, s in tried if s > wanted and a > low), default=math.inf)
        if low >= largest:
            break
        size(_next(tried, wanted, low, min(high, largest), bounded=math.isfinite(high)))
    return _nearest(tried, wanted)


def _nearest(tried: list[tuple[float, float]], wanted: float) -> tuple[float, float]:
    """The trial with the nearest size by ratio; if all failed or did nothing, the largest."""
    return min(tried, key=lambda trial: (_distance(trial[1], wanted), -trial[0]))


def _distance(size: float, wanted: float) -> float:
    return abs(math.log(size / wanted)) if _NOTHING < size < math.inf else math.inf


def _next(
    tried: list[tuple[float, float]], wanted: float, low: float, high: float, *, bounded: bool
) -> float:
    known = sorted((t for t in tried if _NOTHING < t[1] < math.inf), key=lambda t: _distance(t[1], wanted))
    if not known:
        if not bounded:
            return min(high, low * _LEAP)
        return math.sqrt(low * high) if low else high / _LEAP
    amplitude, size = known[0]
    power = 1.0
    if len(known) > 1 and known[1][0] != amplitude:
        slope = math.log(size / known[1][1]) / math.log(amplitude / known[1][0])
        power = min(max(slope, 0.3), 3.0)
    guess = amplitude * min(max(math.pow(wanted / size, 1.0 / power), 1.0 / _LEAP), _LEAP)
    if low < guess < high or (guess == high and not bounded):
        return guess
    if not bounded:
        return min(guess, high)
    return math.sqrt(low * high) if low else 0.5 * min(high, guess)
