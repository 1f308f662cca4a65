"""Noise that depends on a channel's level or rate of change.

In: records of one channel. Out: a `VarianceLaw`, or None if a single σ describes it. Noise estimated at rest
need not hold in motion; but what is fast in motion may be the signal, so that a law has to be significant,
frequent, and confirmed by differences of another order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.kernels.sizes import LANES, TILE
from rigctl.noise.record import NoiseRecord

Floats = NDArray[np.float64]

#: samples in a block; the signal in it is removed by differences, not by a trend
BLOCK = 20
#: order of the difference from which the variance is estimated, and the order that must agree with it: a
#: smooth signal leaves much less in the higher one
_ORDER, _CHECK = 4, 6
#: largest ratio of the two for a block that shows noise alone
_AGREE = 1.6
#: slow noise with less than this share of the spectral density of white noise at the highest frequency hardly
#: contributes to differences: these show the signal
_SEEN = 0.1
#: least number of blocks for a law
_FEWEST = 12
#: least increase of 2·ln L for a term: 0.01 % at one degree of freedom
_PAYS = 15.0
#: least ratio of sigma to that at rest in the blocks that show a law
_WIDER = 1.25
#: least shares of such blocks: a bench that is excited rings while it changes fast, and not for long
_OFTEN, _SOMETIMES = 0.2, 0.05
#: largest ratio of the median variance of these blocks to the law's: a few large ones among many small ones
#: are a signal, such as ringing, that only occurs where the channel is fast
_MIDDLE = 1.5
#: samples after a switch that are in no block: a signal faster than the sampling looks like noise there
_GUARD = 10
#: blocks beyond this quantile under the law hold a signal, and are left out
_TRIMMED = 1e-3
_ROUNDS = 6
_STEPS = 100
#: samples on either side over which a channel's level and slope are averaged
_SMOOTHED = 5
#: least variance at rest, as a share of a block's typical one
_SMALLEST = 1e-6
#: a smaller mean, or sum of means, counts as this one: it is divided by
_NOTHING = 1e-300


@dataclass(frozen=True)
class VarianceLaw:
    """``σ² = floor² + shot·|y − origin| + (level·(y − origin))² + (rate·dy/dt)²``.

    Parameters
    ----------
    floor: σ at rest, SI.
    level: σ for each unit of the channel's distance from `origin`.
    rate: s, σ for each unit per second of its slope.
    origin: SI, from which the channel's level is measured.
    degrees: of freedom of the blocks or differences from which the law was learned.
    shot: SI, σ² for each unit of that distance: for counted events (shot noise) and, together with `level`,
        for a σ that is linear in the level.
    """

    floor: float
    level: float
    rate: float
    origin: float
    degrees: int
    shot: float = 0.0

    def sigma(self, level: Floats, slope: Floats) -> Floats:
        """σ (SI) at a smoothed level (SI) and its slope (SI/s)."""
        distance = np.abs(level - self.origin)
        squares = self.shot * distance + (self.level * distance) ** 2 + (self.rate * slope) ** 2
        return np.sqrt(self.floor**2 + squares)

    def scaled(self, factor: float) -> VarianceLaw:
        """This law for noise `factor` times as large."""
        return replace(
            self,
            floor=self.floor * factor,
            level=self.level * factor,
            rate=self.rate * factor,
            shot=self.shot * factor**2,
        )


def smooth_course(times: Floats, values: Floats) -> tuple[Floats, Floats]:
    """A channel's level (SI) and slope (SI/s) at each sample: means over `_SMOOTHED` samples on either side.

    Missing values are bridged linearly; a record without a value has level and slope 0.
    """
    from scipy.ndimage import uniform_filter1d

    present = np.isfinite(values)
    if not present.any():
        return np.zeros(values.size), np.zeros(values.size)
    filled = np.interp(times, times[present], values[present])
    level = uniform_filter1d(filled, min(2 * _SMOOTHED + 1, filled.size), mode="nearest")
    return level, np.gradient(level, times) if filled.size > 1 else np.zeros(1)


def variance_law(
    records: Sequence[NoiseRecord],
    ok: Sequence[NDArray[np.bool_]],
    channel: int,
    spacing: float,
    *,
    correlation: float = 0.0,
    white: float = 0.0,
    step: float = 0.0,
) -> VarianceLaw | None:
    """The dependence of one channel's noise on its level and its rate; None if there is none.

    The variance of each block of `BLOCK` samples inside a phase is estimated from fourth differences,
    ``v = mean (wᵀy)²/(wᵀRw)``, R the correlation of the noise. A smooth signal leaves less the higher the
    order is, noise the same: blocks whose sixth differences disagree (by a factor of 1.6) show a signal and
    are left out. The others are distributed like ``σ²·χ²(ν)/ν``, ν by Satterthwaite, and the law is the one
    of highest likelihood without negative terms. A term is included if it raises 2·ln L by more than 15 and
    increases σ by at least a quarter.

    Parameters
    ----------
    correlation, white: of the noise, as in `ChannelNoise`.
    step: SI, of the channel's converter. Noise at rest that is smaller than a step has no law: its variance
        depends on the position of the level between the steps.

    Source: Davidian & Carroll, J. Am. Stat. Assoc. 82 (1987) 1079 (variance functions); Gasser, Sroka &
    Jennen-Steinmetz, Biometrika 73 (1986) 625 (differences).
    """
    # Differences see only fast noise. Where hardly any is fast, they would show the signal.
    if (1.0 - white) * (1.0 - correlation) / (1.0 + correlation) + white < _SEEN:
        return None
    blocks = _blocks(records, ok, channel, spacing, correlation, white)
    if blocks is None:
        return None
    # Regressors of the block variances: 1, (y − y₀)², (dy/dt)², each averaged over the block.
    origin = _origin(blocks.level)
    levels = (blocks.level - origin) ** 2 + blocks.within
    terms = np.column_stack([np.ones(levels.size), levels, blocks.slopes])
    squares, inliers = _chosen_terms(terms, blocks)
    squares[0] = max(squares[0], _SMALLEST * float(np.median(blocks.variance)))
    if squares[0] < step**2 or not _borne_out(terms, squares, blocks):
        return None
    floor, per_level, per_rate = np.sqrt(squares).tolist()
    return VarianceLaw(floor, per_level, per_rate, origin, int(blocks.degrees * inliers.sum()))


@dataclass(frozen=True)
class _Blocks:
    """(blocks) variance of each (SI²), mean level, mean square of the level about it, and of the slope.

    `degrees` are the degrees of freedom of each variance.
    """

    variance: Floats
    level: Floats
    within: Floats
    slopes: Floats
    degrees: float


def _blocks(
    records: Sequence[NoiseRecord],
    ok: Sequence[NDArray[np.bool_]],
    channel: int,
    spacing: float,
    correlation: float,
    white: float,
) -> _Blocks | None:
    """The blocks that show noise alone; None if there are too few."""
    weights = [difference_weights(order, correlation, white) for order in (_ORDER, _CHECK)]
    rows = [
        _blocks_of(record.times, record.values[:, channel], mask[:, channel], record.phase, spacing, weights)
        for record, mask in zip(records, ok, strict=True)
    ]
    every = np.concatenate(rows) if rows else np.empty((0, 5))
    squares, check = every[:, 0], every[:, 1]
    good = (squares > 0.0) & (check < _AGREE * squares) & (squares < _AGREE * check)
    if good.sum() < _FEWEST:
        return None
    variance, _, level, within, slopes = every[good].T
    return _Blocks(variance, level, within, slopes, difference_degrees(weights[0], correlation, white))


def _blocks_of(
    times: Floats,
    values: Floats,
    ok: NDArray[np.bool_],
    phase: NDArray[np.intp],
    spacing: float,
    weights: Sequence[Floats],
) -> Floats:
    """(blocks, 5) of one record: variance by either order, mean, mean square about it and of the slope.

    The latter two are those of the block's quadratic.
    """
    if times.size < BLOCK:
        return np.empty((0, 5))
    even = np.abs(np.diff(times) - spacing) < 0.1 * spacing
    # Blocks lie within a period of constant commands, evenly sampled, and some samples after its switch.
    joined = ok[1:] & ok[:-1] & even & (np.diff(phase) == 0)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], joined, [False]]).astype(np.int8)))
    starts = [
        start
        for begin, end in ends.reshape(-1, 2).tolist()
        for start in range(begin + (_GUARD if begin else 0), end + 2 - BLOCK, BLOCK)
    ]
    if not starts:
        return np.empty((0, 5))
    rows = values[np.array(starts)[:, None] + np.arange(BLOCK)]
    middle = rows.mean(axis=1)
    rows = rows - middle[:, None]
    squares = [
        np.mean((np.lib.stride_tricks.sliding_window_view(rows, w.size, axis=1) @ w) ** 2, axis=1)
        for w in weights
    ]
    at = (np.arange(BLOCK) - 0.5 * (BLOCK - 1)) * spacing
    curve = at**2 - np.mean(at**2)
    slope, bend = rows @ at / float(at @ at), rows @ curve / float(curve @ curve)
    within = slope**2 * np.mean(at**2) + bend**2 * np.mean(curve**2)
    return np.column_stack([*squares, middle, within, slope**2 + 4.0 * bend**2 * np.mean(at**2)])


@lru_cache(maxsize=16)
def difference_weights(order: int, correlation: float, white: float) -> Floats:
    """Weights of a difference with variance 1 for noise of variance 1 with that correlation."""
    weights = np.array([1.0])
    for _ in range(order):
        weights = np.convolve(weights, [1.0, -1.0])
    variance = weights @ _correlations(weights.size, correlation, white) @ weights
    return np.asarray(weights / np.sqrt(variance))


def _correlations(size: int, correlation: float, white: float) -> Floats:
    apart = np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
    return np.asarray((1.0 - white) * correlation**apart + white * (apart == 0))


def difference_degrees(weights: Floats, correlation: float, white: float, samples: int = BLOCK) -> float:
    """Degrees of freedom of the mean square of the differences of this many samples: ``tr(C)²/tr(C²)``."""
    count = samples - weights.size + 1
    rows = np.zeros((count, samples))
    for k in range(count):
        rows[k, k : k + weights.size] = weights
    covariance = rows @ _correlations(samples, correlation, white) @ rows.T
    return float(np.trace(covariance) ** 2 / np.sum(covariance**2))


def _origin(level: Floats) -> float:
    """The origin of a level: 0 if the channel comes near it, else its minimum."""
    size = np.abs(level)
    return 0.0 if size.min() < 0.25 * size.max() else float(level[np.argmin(size)])


def _chosen_terms(terms: Floats, blocks: _Blocks) -> tuple[Floats, NDArray[np.bool_]]:
    """The squares of floor, level and rate, 0 for insignificant ones; and the blocks from which they come."""
    costs = {
        columns: _cost(terms[:, columns], blocks) + _PAYS * len(columns)
        for columns in ((0,), (0, 1), (0, 2), (0, 1, 2))
    }
    chosen = list(min(costs, key=lambda columns: costs[columns]))
    full = np.zeros(terms.shape[1])
    full[chosen], inliers = _trimmed(terms[:, chosen], blocks)
    return full, inliers


def _borne_out(terms: Floats, squares: Floats, blocks: _Blocks) -> bool:
    """Whether enough blocks show larger noise than at rest, and most of them as large as predicted."""
    from scipy.special import gammaincinv

    mean = terms @ squares
    wider = mean > _WIDER**2 * squares[0]
    if wider.sum() < max(_FEWEST, (_OFTEN if squares[2] > 0.0 else _SOMETIMES) * wider.size):
        return False
    ratio = np.median(blocks.variance[wider] / mean[wider]) * blocks.degrees
    median = 2.0 * gammaincinv(0.5 * blocks.degrees, 0.5)  # of χ²
    return bool(1.0 / _MIDDLE < ratio / median < _MIDDLE)


def _cost(terms: Floats, blocks: _Blocks) -> float:
    """−2·ln L of a law over all blocks."""
    mean = np.maximum(terms @ most_likely_squares(terms, blocks.variance), 1e-300)
    return blocks.degrees * float(np.sum(np.log(mean) + blocks.variance / mean))


def _trimmed(terms: Floats, blocks: _Blocks) -> tuple[Floats, NDArray[np.bool_]]:
    """The law over the blocks that agree with it: those far above it hold a signal."""
    from scipy.special import chdtri

    variance = blocks.variance
    most = float(chdtri(blocks.degrees, _TRIMMED)) / blocks.degrees
    inliers = np.ones(variance.size, bool)
    for _ in range(_ROUNDS):
        squares = most_likely_squares(terms[inliers], variance[inliers])
        stay = variance <= most * np.maximum(terms @ squares, 1e-300)
        if stay.sum() < _FEWEST or np.array_equal(stay, inliers):
            break
        inliers = stay
    return squares, inliers


def most_likely_squares(terms: Floats, variance: Floats) -> Floats:
    """The non-negative squares of highest likelihood: ``s_k ← s_k·√(Σ t_k·v/μ² / Σ t_k/μ)``, μ = t·s.

    Each step lowers ``Σ (ln μ + v/μ)``: C. Févotte & J. Idier, Neural Computation 23 (2011) 2421.

    Parameters
    ----------
    terms: (n, k) t, at most three.
    variance: (n) v.
    """
    from rigctl.engine.compile import kernel, words_of
    from rigctl.engine.guards import width

    count, columns = terms.shape
    length = -(-count // LANES) * LANES
    # vector instructions read what begins at a multiple of their length twice as fast
    storage = _aligned((columns + 1) * length + 2 * TILE + 2 * columns * LANES)
    rows, values, work = np.split(storage, [columns * length, (columns + 1) * length])
    rows = rows.reshape(columns, length)
    rows[:, :count], values[:count] = terms.T, variance
    typical = np.maximum(terms.mean(axis=0), _NOTHING)
    squares: Floats = np.full(columns, float(variance.mean())) / (columns * typical)
    steps = np.array([_STEPS], dtype=np.int64)
    kernel("variances", width() > 0)(words_of(steps, rows, values, squares, work))
    return squares


def _aligned(size: int) -> Floats:
    """Zeros, at an address that is a multiple of `LANES` doubles."""
    padded = np.zeros(size + LANES)
    first = -(padded.ctypes.data // padded.itemsize) % LANES
    return padded[first : first + size]
