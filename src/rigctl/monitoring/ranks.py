"""Series as ranks: their scores, and the autocorrelation of neighbours.

All functions take many series at once, (courses, runs): the measured one and the simulated ones undergo the
same computation.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.monitoring.change_point import FEWEST_BESIDE, cuts_of

Floats = NDArray[np.float64]

#: scores of ranks are clipped at this value: of an outlier only its sign remains
_MOST: Final = 1.0
#: a run is clipped at this multiple of the usual difference of neighbours
_OFF: Final = 3.0
#: a larger difference of neighbours, relative to the usual one, is a jump: one in 1400 for normal values
_JUMP: Final = 5.0
#: the share of the squared differences that enter the autocorrelation, the smaller ones
_KEPT: Final = 0.75


def normal_scores(values: Floats) -> Floats:
    """Normal scores of the ranks along the last axis, ties sharing theirs, with mean square one."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    scores = np.clip(ndtri((rankdata(values, axis=-1) - 0.5) / values.shape[-1]), -_MOST, _MOST)
    size = np.sqrt(np.mean(np.square(scores), axis=-1, keepdims=True))
    return np.asarray(scores / np.where(size > 0.0, size, 1.0))


def drawn_scores(values: Floats) -> Floats:
    """Rank scores of simulated courses, shape (courses, runs), which have no ties."""
    count = values.shape[1]
    scores = np.empty_like(values)
    ordered = np.broadcast_to(normal_scores(np.arange(count, dtype=float)), values.shape)
    np.put_along_axis(scores, np.argsort(values, axis=1), ordered, axis=1)
    return scores


def neighbours(values: Floats, scores: Floats) -> Floats:
    """(courses) estimated autocorrelation at lag 1 with steps and ramps removed.

    The minimum of four estimates, because a change that affects one does not affect another: the
    autocorrelation of the residuals from the nearest step or ramp, of the scores, and of the clipped values,
    in which a steady ramp is linear; that of the periods between significant jumps, each about its mean; and
    one from the squared differences at lags 1 and 2 without the largest, which are proportional to 1 − ρ and
    1 − ρ². All are biased, but are only compared with the same estimate for simulated series.

    Parameters
    ----------
    values: (courses, runs); `scores` their normal scores.
    """
    if scores.shape[1] < 2 * FEWEST_BESIDE:
        return np.zeros(scores.shape[0])
    # Four estimates, each spoilt by some kind of change and not by the others. A change makes an estimate
    # larger, so that the smallest is taken. That it is then biased does no harm: simulated series have the
    # same bias.
    near, far = (_usual(scores[:, lag:] - scores[:, :-lag]) for lag in (1, 2))
    usual = np.median(np.abs(np.diff(values, axis=1)), axis=1, keepdims=True)
    scaled = values / np.where(usual > 0.0, usual, 1.0)
    figures = (
        _correlation(_residuals(scores)),
        _correlation(_residuals(_clipped(scaled))),
        _between_jumps(scaled),
        far / np.maximum(near, 1e-12) - 1.0,
    )
    return np.asarray(np.min(figures, axis=0))


def _between_jumps(values: Floats) -> Floats:
    """The autocorrelation of neighbours without a jump between them, each period about its mean."""
    jumps = np.abs(np.diff(values, axis=1)) > _JUMP
    first = np.ones((len(values), 1), dtype=bool)  # no period continues into the next series
    stretch = np.cumsum(np.concatenate([first, jumps], axis=1)).reshape(values.shape) - 1
    flat = stretch.ravel()
    means = np.bincount(flat, weights=values.ravel()) / np.bincount(flat)
    deviations = values - means[stretch]
    products = np.where(jumps, 0.0, deviations[:, 1:] * deviations[:, :-1])
    return np.asarray(np.sum(products, axis=1) / np.maximum(np.sum(np.square(deviations), axis=1), 1e-9))


def _clipped(values: Floats) -> Floats:
    """Each run clipped to a distance from the median of three, itself and its neighbours."""
    padded = np.concatenate([values[:, 2:3], values, values[:, -3:-2]], axis=1)
    before, after = padded[:, :-2], padded[:, 2:]
    low, high = np.minimum(before, after), np.maximum(before, after)
    middle = np.maximum(low, np.minimum(high, values))
    return np.asarray(middle + np.clip(values - middle, -_OFF, _OFF))


def _correlation(deviations: Floats) -> Floats:
    square = np.sum(np.square(deviations), axis=1)
    return np.asarray(np.sum(deviations[:, 1:] * deviations[:, :-1], axis=1) / np.maximum(square, 1e-9))


def _usual(differences: Floats) -> Floats:
    """The mean square of all but the largest differences."""
    squares = np.sort(np.square(differences), axis=1)
    return np.asarray(np.mean(squares[:, : max(1, round(_KEPT * squares.shape[1]))], axis=1))


def _residuals(scores: Floats) -> Floats:
    """The residuals of each series from the nearest step, or ramp from or to some run."""
    shapes = _shapes(scores.shape[1])
    centred = scores - scores.mean(axis=1, keepdims=True)
    sizes = centred @ shapes.T
    best = np.argmax(np.abs(sizes), axis=1)
    return np.asarray(centred - sizes[np.arange(len(best)), best][:, None] * shapes[best])


@lru_cache(maxsize=16)
def _shapes(count: int) -> Floats:
    """(shapes, runs) with zero mean and unit length."""
    positions, shapes = np.arange(count, dtype=float), []
    for cut in cuts_of(count, None).tolist():
        for moved in (positions >= cut, np.maximum(positions - cut, 0.0), np.minimum(positions, cut)):
            centred = moved - np.mean(moved)
            shapes.append(centred / np.linalg.norm(centred))
    return np.array(shapes)
