"""The white part of a channel's noise, from differences of rising order, whatever the bench does.

A difference of order k removes every polynomial of degree k − 1. White noise keeps the same scaled variance
at every order, while a signal that is smooth over a few samples falls from order to order. Where the scaled
differences stop falling (a *plateau*), only white noise is left: its level is measured although nothing is
at rest. Where they still fall at the highest order, the last one is an upper bound.

The floor is a lower bound of the whole noise: drift, 1/f and correlated noise are removed like a signal.

Source: von Neumann et al., Ann. Math. Stat. 12 (1941) 153; Gasser, Sroka & Jennen-Steinmetz, Biometrika 73
(1986) 625; Hall, Kay & Titterington, Biometrika 77 (1990) 521 (differences). The plateau over orders is ours.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.record import own_spacing
from rigctl.noise.variance import difference_degrees

Floats = NDArray[np.float64]

#: orders of the difference that are compared
_ORDERS = range(1, 9)
#: a plateau begins where the next order, and the one after it, differ by no more than these shares
_NEXT, _AFTER = 0.10, 0.15
#: number of orders of which a plateau consists
LEAST_ORDERS = 3
#: least number of differences of an order
_FEWEST = 20
#: two neighbouring times are consecutive if they differ from the usual spacing by no more than this share
_EVEN = 0.3
#: median of |z| of a standard normal z
_MEDIAN = 0.6745
#: efficiency of the median of absolute values as an estimate of a standard deviation
_EFFICIENCY = 0.37
#: of a converter with coarse steps: share of the differences that is kept, E[z²] of a standard normal z whose
#: absolute value is among that share, and the efficiency of their root mean square
_KEPT, _KEPT_SQUARE, _KEPT_EFFICIENCY = 0.9, 0.623, 0.78
#: number of samples over which the overlap of differences is computed
_STRETCH = 40


@dataclass(frozen=True)
class Floor:
    """The white floor of one channel.

    Attributes
    ----------
    sigma: SI, its standard deviation; an upper bound of it if there is no plateau.
    order: of the difference at which the plateau begins; 0 if there is none.
    degrees: of freedom of sigma.
    orders: SI, the scaled differences of every order that has enough of them.
    """

    sigma: float
    order: int
    degrees: int
    orders: tuple[float, ...] = ()

    @property
    def measured(self) -> bool:
        """Whether there is a plateau: sigma is then measured, and not only bounded from above."""
        return self.order > 0


def white_floor(pieces: Sequence[Floats], *, coarse: bool = False) -> Floor | None:
    """The white floor of evenly sampled pieces of one channel; None if there are too few readings.

    ``s_k = median|d_k|/(0.6745·‖w_k‖)``, d_k the differences of order k with the weights
    ``w_kj = (−1)^j·C(k, j)``. The median is robust to switches and a few outliers.

    Parameters
    ----------
    pieces: readings (SI) without gaps, each in order of time, see `even_pieces`.
    coarse: the readings are a converter's steps, so that differences take few values. A median would be one
        of these; the root mean square of the smallest nine tenths varies continuously.
    """
    scale = _trimmed_scale if coarse else _median_scale
    efficiency = _KEPT_EFFICIENCY if coarse else _EFFICIENCY
    scales: list[float] = []
    counts: list[int] = []
    # s_k for k = 1 … 8: a falling sequence for a signal, a constant one for white noise.
    for order in _ORDERS:
        differences = _differences(pieces, order)
        if differences.size < _FEWEST:
            break
        scales.append(scale(differences) / _norm(order))
        counts.append(differences.size)
    if not scales:
        return None
    order = plateau(scales)
    # Without a plateau the last order counts, as an upper bound. Differences overlap, so that degrees of
    # freedom are fewer than differences, and a median uses them less well than a mean square.
    at = (order or len(scales)) - 1
    degrees = int(efficiency * counts[at] * _share_of_degrees(at + 1))
    return Floor(scales[at], order, max(degrees, 1), tuple(scales))


def floor_of_residuals(pieces: Sequence[Floats], order: int) -> tuple[float, int]:
    """Root mean square (SI) of the scaled differences of one order, and its degrees of freedom.

    Of a model's residuals, from which the signal is mostly gone; unlike the median it counts heavy tails as a
    sum of squares does. NaN if there are too few.
    """
    differences = _differences(pieces, order)
    if differences.size < _FEWEST:
        return math.nan, 0
    scale = float(np.sqrt(np.mean(differences**2))) / _norm(order)
    return scale, max(1, int(differences.size * _share_of_degrees(order)))


def even_pieces(
    times: Floats, values: Floats, spacing: float, periods: NDArray[np.intp] | None = None
) -> Iterator[Floats]:
    """The readings between gaps and missing values: stretches of a record with even sampling.

    Parameters
    ----------
    periods: number of the period of constant commands to which each reading belongs; no stretch then holds
        readings of two.
    spacing: the usual time between rows, s; see `own_spacing`.
    """
    good = np.isfinite(values)
    times, values = times[good], values[good]
    step = own_spacing([times], spacing)
    joined = np.abs(np.diff(times) - step) <= _EVEN * step
    if periods is not None:
        joined &= np.diff(periods[good]) == 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], joined, [False]]).astype(np.int8)))
    for first, last in edges.reshape(-1, 2).tolist():
        yield values[first : last + 1]


def plateau(scales: Sequence[float]) -> int:
    """The lowest order, from 1, from which the scaled differences of two further ones agree; 0 if none."""
    for index in range(len(scales) - 2):
        this, following, after = scales[index : index + 3]
        if this > 0.0 and abs(following / this - 1.0) < _NEXT and abs(after / this - 1.0) < _AFTER:
            return index + 1
    return 0


def _median_scale(differences: Floats) -> float:
    return float(np.median(np.abs(differences))) / _MEDIAN


def _trimmed_scale(differences: Floats) -> float:
    squares = np.sort(differences**2)[: int(_KEPT * differences.size)]
    return math.sqrt(float(np.mean(squares)) / _KEPT_SQUARE)


def _differences(pieces: Sequence[Floats], order: int) -> Floats:
    weights = _weights(order)
    parts = [np.convolve(piece, weights, "valid") for piece in pieces if piece.size > order]
    return np.concatenate(parts) if parts else np.empty(0)


@lru_cache
def _weights(order: int) -> Floats:
    return np.array([(-1.0) ** j * math.comb(order, j) for j in range(order + 1)])


def _norm(order: int) -> float:
    return float(np.linalg.norm(_weights(order)))


@lru_cache
def _share_of_degrees(order: int) -> float:
    """Degrees of freedom of the mean square of differences of white noise, per difference: they overlap."""
    return difference_degrees(_weights(order), 0.0, 0.0, _STRETCH) / (_STRETCH - order)
