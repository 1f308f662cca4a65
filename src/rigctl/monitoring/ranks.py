"""Courses as ranks: their scores, how alike neighbours are, and the size of the largest change of all ends.

Everything here takes many courses at once, (courses, runs): one that was measured and those that chance draws
go through the same arithmetic.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
#: after which runs a change may lie; None where after any
Apart = tuple[bool, ...] | None

#: a change is not claimed that rests on fewer runs on one of its sides
FEWEST_BESIDE: Final = 3
#: scores of ranks further out count as this: of an outlier only its side is left
_MOST: Final = 1.0
#: how many usual differences of neighbours a run may be off before it counts as no further
_OFF: Final = 3.0
#: a difference of neighbours of so many usual ones is a jump: of normal ones one in 1400 is
_JUMP: Final = 5.0
#: ends and, for each, cuts that are scanned at most
_ENDS: Final = 120
_CUTS: Final = 40
#: the share of the differences that show how alike neighbours are, the smaller ones
_KEPT: Final = 0.75


def normal_scores(values: Floats) -> Floats:
    """Normal scores of the ranks along the last axis, equal values sharing theirs, of mean square one."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    scores = np.clip(ndtri((rankdata(values, axis=-1) - 0.5) / values.shape[-1]), -_MOST, _MOST)
    size = np.sqrt(np.mean(np.square(scores), axis=-1, keepdims=True))
    return np.asarray(scores / np.where(size > 0.0, size, 1.0))


def drawn_scores(values: Floats) -> Floats:
    """The same of (courses, runs) that were drawn, no two of one course being equal."""
    count = values.shape[1]
    scores = np.empty_like(values)
    ordered = np.broadcast_to(normal_scores(np.arange(count, dtype=float)), values.shape)
    np.put_along_axis(scores, np.argsort(values, axis=1), ordered, axis=1)
    return scores


def apart_in(over: Floats) -> Apart:
    """After which runs a change may lie: before those at another place; None where after any."""
    apart = tuple(bool(step > 0.0) for step in np.diff(over))
    return None if all(apart) else apart


def neighbours(values: Floats, scores: Floats) -> Floats:
    """(courses) how alike neighbouring runs are, with no step and no growth in it.

    The smallest of four figures, since a change that enters one is not in another. What the nearest step or
    growth leaves has a correlation of neighbours: that of the scores, and of the values, outliers tamed, in
    which a steady growth is straight. The stretches between jumps that no scatter makes have one of their
    own, each about its mean. And the squared differences of neighbours and of next but one, the largest of
    them left out, are as 1 − ρ and 1 − ρ². All are biased; they are only ever compared with themselves in
    courses that were drawn.

    Parameters
    ----------
    values: (courses, runs); `scores` their normal scores.
    """
    if scores.shape[1] < 2 * FEWEST_BESIDE:
        return np.zeros(scores.shape[0])
    near, far = (_usual(scores[:, lag:] - scores[:, :-lag]) for lag in (1, 2))
    usual = np.median(np.abs(np.diff(values, axis=1)), axis=1, keepdims=True)
    scaled = values / np.where(usual > 0.0, usual, 1.0)
    figures = (
        _correlation(_left(scores)),
        _correlation(_left(_tamed(scaled))),
        _between_jumps(scaled),
        far / np.maximum(near, 1e-12) - 1.0,
    )
    return np.asarray(np.min(figures, axis=0))


def _between_jumps(values: Floats) -> Floats:
    """The correlation of neighbours between which no jump lies, each stretch about its mean."""
    jumps = np.abs(np.diff(values, axis=1)) > _JUMP
    first = np.ones((len(values), 1), dtype=bool)  # no stretch goes on in the next course
    stretch = np.cumsum(np.concatenate([first, jumps], axis=1)).reshape(values.shape) - 1
    flat = stretch.ravel()
    means = np.bincount(flat, weights=values.ravel()) / np.bincount(flat)
    left = values - means[stretch]
    products = np.where(jumps, 0.0, left[:, 1:] * left[:, :-1])
    return np.asarray(np.sum(products, axis=1) / np.maximum(np.sum(np.square(left), axis=1), 1e-9))


def _tamed(values: Floats) -> Floats:
    """No run is far from the median of three, itself and its neighbours."""
    padded = np.concatenate([values[:, 2:3], values, values[:, -3:-2]], axis=1)
    before, after = padded[:, :-2], padded[:, 2:]
    low, high = np.minimum(before, after), np.maximum(before, after)
    middle = np.maximum(low, np.minimum(high, values))
    return np.asarray(middle + np.clip(values - middle, -_OFF, _OFF))


def _correlation(left: Floats) -> Floats:
    square = np.sum(np.square(left), axis=1)
    return np.asarray(np.sum(left[:, 1:] * left[:, :-1], axis=1) / np.maximum(square, 1e-9))


def _usual(differences: Floats) -> Floats:
    """The mean square of all but the largest differences."""
    squares = np.sort(np.square(differences), axis=1)
    return np.asarray(np.mean(squares[:, : max(1, round(_KEPT * squares.shape[1]))], axis=1))


def _left(scores: Floats) -> Floats:
    """What the nearest step, or growth from or up to some run, leaves of each course."""
    shapes = _shapes(scores.shape[1])
    centred = scores - scores.mean(axis=1, keepdims=True)
    sizes = centred @ shapes.T
    best = np.argmax(np.abs(sizes), axis=1)
    return np.asarray(centred - sizes[np.arange(len(best)), best][:, None] * shapes[best])


@lru_cache(maxsize=16)
def _shapes(count: int) -> Floats:
    """(shapes, runs) of mean zero and length one."""
    places, found = np.arange(count, dtype=float), []
    for cut in _cuts(count, None).tolist():
        for moved in (places >= cut, np.maximum(places - cut, 0.0), np.minimum(places, cut)):
            centred = moved - np.mean(moved)
            found.append(centred / np.linalg.norm(centred))
    return np.array(found)


def sizes(scores: Floats, apart: Apart) -> tuple[tuple[int, ...], Floats]:
    """The ends that are scanned, and (courses, ends) the largest size at each of them."""
    count = scores.shape[1]
    sums, squares = np.cumsum(scores, axis=1), np.cumsum(np.square(scores), axis=1)
    moments = np.cumsum(scores * np.arange(1, count + 1, dtype=float), axis=1)
    ends, found = [], []
    for n in _ends(count):
        cuts = _cuts(n, apart)
        if not cuts.size:
            continue
        whole = sums[:, n - 1]
        spread = np.maximum(squares[:, n - 1] - whole * whole / n, 1e-12)
        before = sums[:, cuts - 1]
        difference = (whole[:, None] - before) / (n - cuts) - before / cuts
        explained = np.max(np.square(difference) / (1.0 / cuts + 1.0 / (n - cuts)), axis=1)
        line = np.square(moments[:, n - 1] - 0.5 * (n + 1) * whole) / (n * (n * n - 1.0) / 12.0)
        share = np.minimum(np.maximum(explained, line) / spread, 1.0 - 1e-9)
        ends.append(n)
        found.append(np.sqrt(-(n - 1.5) * np.log1p(-share)))
    return tuple(ends), np.stack(found, axis=1) if found else np.empty((scores.shape[0], 0))


def _ends(count: int) -> list[int]:
    """The numbers of runs after which it is looked, the last among them."""
    first = 2 * FEWEST_BESIDE
    if count < first:
        return []
    every = np.linspace(first, count, min(count - first + 1, _ENDS))
    return sorted({round(float(n)) for n in every})


@lru_cache(maxsize=8192)
def _cuts(n: int, apart: Apart) -> Indices:
    """After which of the first n runs a change may have come, denser towards both ends."""
    first, last = FEWEST_BESIDE, n - FEWEST_BESIDE
    if last - first + 1 <= _CUTS:
        cuts = np.arange(first, last + 1)
    else:
        half = np.geomspace(first, 0.5 * n, _CUTS // 2)
        cuts = np.unique(np.round(np.concatenate([half, n - half])).astype(np.intp))
    if apart is not None:
        cuts = cuts[np.array(apart)[cuts - 1]]
    return cuts
