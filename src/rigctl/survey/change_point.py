"""Does a course of values change? A scan over all ways to cut it, and what chance makes of that scan.

The values x_1 … x_N of one quantity, a run each, in the order of the date or of whatever they are looked at
over, are replaced by normal scores of their ranks, ``q = Φ⁻¹((rank − ½)/N)`` within ±1. Scanned are all ends
n and, for each of them, a step after every run k and the straight line through the first n: of the squares of
q about their mean the share R² that it explains, as the root of a likelihood ratio,

    Z = √(−(n − 3/2)·ln(1 − R²))

The statistic is the largest of all. So it pays for every run on which a change could have begun and for every
run after which it could have been seen.

What chance makes of it is drawn: Gaussian sequences whose neighbours have the correlation that the course
shows, ranked and scanned likewise. Without correlation this is the permutation distribution, exact for
whatever the scatter from run to run is drawn from: of an outlier only its side counts.

Sources: A. N. Pettitt, Appl. Statist. 28 (1979) 126 (ranks, an unknown change point); the end is scanned too,
as in sequential detection (D. Siegmund, Sequential Analysis, 1985).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.survey.course import tamed, whole_scatter

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

#: a change is not told that rests on fewer runs on one of its sides
FEWEST_BESIDE: Final = 3
#: scores of ranks further out count as this: of an outlier only its side is left
_MOST = 1.0
#: ends and, for each, cuts that are scanned at most
_ENDS, _CUTS = 120, 40
#: sequences that are drawn, and at a time
_DRAWS, _AT_ONCE = 20_000, 2_000
#: clear steps whose median is the clearest that is promised
_CLEAR = 101
#: correlations of neighbours are rounded up to a multiple of this, so that few distributions are drawn
_STEP = 0.1
_STRONGEST = 0.9
#: a correlation of more of its standard errors than this is no chance
_SEEN = 1.0
#: what a fitted step or growth takes away of it, over the number of runs
_TAKEN = 3.0
#: the share of the differences that tell it, the smaller ones
_KEPT = 0.75


@dataclass(frozen=True)
class Scan:
    """What the scan of one course found.

    Attributes
    ----------
    statistic: the largest size of all.
    p_value: how often chance reaches it, this course alone.
    cut: the runs before the change of the largest size at the last end: the first `cut` ones.
    first_end: after so many runs the statistic is as large as `sure_from` for the first time; None where it
        is never.
    correlation: of neighbours, as it was used.
    """

    statistic: float
    p_value: float
    correlation: float
    ends: tuple[int, ...]
    at_ends: tuple[float, ...]

    def first_end(self, least: float) -> int | None:
        """After how many runs the scan is as large as `least` for the first time; None where it never is."""
        return next((n for n, size in zip(self.ends, self.at_ends, strict=True) if size >= least), None)


def scan(values: Floats, over: Floats) -> Scan:
    """Scan a course of values.

    Parameters
    ----------
    values: (runs) in the order of `over`, finite.
    over: (runs) where each run lies; between runs at the same place nothing can have changed.
    """
    scores = normal_scores(values)[None, :]
    apart = _apart(over)
    correlation = neighbours(values, scores[0])
    ends, sizes = _sizes(scores, apart)
    largest = float(sizes.max()) if sizes.size else 0.0
    drawn = null(values.size, apart, correlation)
    reached = int(drawn.size - np.searchsorted(drawn, largest * (1.0 - 1e-12), side="left"))
    return Scan(
        statistic=largest,
        p_value=(1 + reached) / (1 + drawn.size),
        correlation=correlation,
        ends=ends,
        at_ends=tuple(float(size) for size in np.maximum.accumulate(sizes[0])) if sizes.size else (),
    )


def critical(over: Floats, correlation: float, level: float) -> float:
    """The size that chance exceeds with probability `level`; infinite where no draw says."""
    drawn = null(over.size, _apart(over), correlation)
    allowed = int(level * (drawn.size + 1)) - 1
    return float(drawn[drawn.size - 1 - allowed]) if allowed >= 0 else float("inf")


def best_possible(over: Floats) -> float:
    """The p-value of the clearest step there is: every value after the middle lies above all before it.

    Within the halves the order is chance; it is the median of such courses.
    """
    half, generator = over.size // 2, np.random.Generator(np.random.PCG64(over.size))
    ranks = np.stack(
        [
            np.concatenate([generator.permutation(half), half + generator.permutation(over.size - half)])
            for _ in range(_CLEAR)
        ]
    )
    _, sizes = _sizes(normal_scores(np.arange(over.size, dtype=float))[ranks], _apart(over))
    if not sizes.size:
        return 1.0
    drawn = null(over.size, _apart(over), 0.0)
    least = float(np.median(sizes.max(axis=1))) * (1.0 - 1e-12)
    return (1 + int(drawn.size - np.searchsorted(drawn, least, side="left"))) / (1 + drawn.size)


def normal_scores(values: Floats) -> Floats:
    """Normal scores of the ranks, equal values sharing theirs, of mean square one."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    scores = np.clip(ndtri((rankdata(values) - 0.5) / values.size), -_MOST, _MOST)
    size = float(np.sqrt(np.mean(np.square(scores))))
    return np.asarray(scores / size if size > 0.0 else scores)


def neighbours(values: Floats, scores: Floats) -> float:
    """The correlation of neighbouring runs, with neither a step nor a steady growth in it; rounded up.

    The smaller of two estimates. Of a sequence with correlations ρ, ρ², … the squared differences of
    neighbours and of next but one are as 1 − ρ and 1 − ρ²: the largest of them left out, steps do not enter
    these, and a steep growth does.
    And of what the nearest step or growth of the values, outliers tamed, or of their scores, leaves, the
    correlation itself, of which it takes some away.
    """
    if scores.size < 2 * FEWEST_BESIDE:
        return 0.0
    tame = tamed(values, whole_scatter(values, np.ones(values.size)))
    near, far = (_usual(values[lag:] - values[:-lag]) for lag in (1, 2))
    if near <= 0.0:
        return 0.0
    after = min(_correlation(_left(scores)), _correlation(normal_scores(_left(tame))))
    after += (_TAKEN + 4.0 * max(after, 0.0)) / scores.size
    found = max(min(far / near - 1.0, after), 0.0)
    error = 1.0 / math.sqrt(scores.size)
    if found > _SEEN * error:  # it is there, and half of the time it is stronger than it looks
        found += error
    return max(0.0, round(math.ceil(min(found, _STRONGEST) / _STEP - 1e-9) * _STEP, 6))


def _usual(differences: Floats) -> float:
    """The mean square of all but the largest differences."""
    squares = np.sort(np.square(differences))
    return float(np.mean(squares[: max(1, round(_KEPT * squares.size))]))


def _correlation(left: Floats) -> float:
    square = float(left @ left)
    return float(left[1:] @ left[:-1]) / square if square > 1e-9 * left.size else 0.0


def _left(scores: Floats) -> Floats:
    """What the nearest step, or growth from some run on, leaves of a course."""
    places = np.arange(scores.size, dtype=float)
    best, least = scores - scores.mean(), math.inf
    for cut in _cuts(scores.size, None).tolist():
        for moved in ((places >= cut).astype(float), np.maximum(places - cut, 0.0), np.minimum(places, cut)):
            centred = moved - moved.mean()
            left = scores - scores.mean() - centred * float(centred @ scores) / float(centred @ centred)
            if (cost := float(left @ left)) < least:
                best, least = left, cost
    return np.asarray(best)


def null(count: int, apart: tuple[bool, ...] | None, correlation: float) -> Floats:
    """(draws) sorted: the statistic of sequences in which nothing changes."""
    return _null(count, apart, correlation)


@lru_cache(maxsize=64)
def _null(count: int, apart: tuple[bool, ...] | None, correlation: float) -> Floats:
    generator = np.random.Generator(np.random.PCG64([20, count, round(1000 * correlation)]))
    scores = normal_scores(np.arange(count, dtype=float))
    found = []
    for _ in range(0, _DRAWS, _AT_ONCE):
        drawn = _sequences(generator, count, correlation)
        ranked = np.argsort(np.argsort(drawn, axis=1), axis=1)
        _, sizes = _sizes(scores[ranked], apart)
        found.append(sizes.max(axis=1) if sizes.size else np.zeros(len(drawn)))
    every = np.concatenate(found)
    every.sort()
    return every


def _sequences(generator: np.random.Generator, count: int, correlation: float) -> Floats:
    """(draws, count) Gaussian sequences of mean 0 and variance 1 whose neighbours are correlated."""
    noise = generator.standard_normal((_AT_ONCE, count))
    if correlation == 0.0:
        return noise
    share = float(np.sqrt(1.0 - correlation**2))
    for k in range(1, count):
        noise[:, k] = correlation * noise[:, k - 1] + share * noise[:, k]
    return noise


def _apart(over: Floats) -> tuple[bool, ...] | None:
    """After which runs a change may lie: before those at another place; None where after any."""
    apart = tuple(bool(step > 0.0) for step in np.diff(over))
    return None if all(apart) else apart


def _sizes(scores: Floats, apart: tuple[bool, ...] | None) -> tuple[tuple[int, ...], Floats]:
    """The ends that are scanned, and (draws, ends) the largest size at each of them."""
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
def _cuts(n: int, apart: tuple[bool, ...] | None) -> Indices:
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
