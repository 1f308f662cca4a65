"""The standard deviation of the noise from differences of a model's residuals, and its dependence on the
level.

In: the residuals of a fitted model, and the levels that it predicts. Out: a `Width`, or None. Where a signal
moves within a few readings its own differences contain motion; the residuals contain only what the model
misses, and differences remove of that what is smooth.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.variance import VarianceLaw, difference_degrees, difference_weights, most_likely_squares

Floats = NDArray[np.float64]

#: orders of the difference, the lowest that shows noise alone first; each has to agree with the next one
_ORDERS = (2, 4, 6)
#: largest ratio of the mean squares of two orders if both show noise alone
_AGREE = 1.15
#: limit for parts of the range of levels, which have fewer differences
_AGREE_IN_PARTS = 1.6
_PARTS = 3
#: least number of differences
_FEWEST = 100
#: least increase of 2·ln L for a term: 0.01 % at one degree of freedom
_PAYS = 15.0
#: σ must exceed its minimum by this factor, in at least this share of the differences
_WIDER, _OFTEN = 1.25, 0.1
#: largest ratio of the median variance among these to the law's
_MIDDLE = 1.5
#: differences beyond this quantile under the law are attributed to a misfit or a spike
_TRIMMED = 1e-3
_ROUNDS = 4
#: least variance anywhere, as a share of the typical one
_SMALLEST = 1e-4
#: kurtosis of normal noise
_NORMAL = 3.0
#: number of samples over which the overlap of differences is computed
_STRETCH = 60
#: a channel read in less than this share of the rows has rows of its own
_SPARSE = 2.0 / 3.0


@dataclass(frozen=True)
class ModelResiduals:
    """A model's residuals for one record.

    Parameters
    ----------
    errors: (n, channels) SI, model less reading; NaN where no reading counts.
    levels: (n, channels) SI, predicted by the model.
    phase: (n) index of the period of constant commands of each sample.
    """

    errors: Floats
    levels: Floats
    phase: NDArray[np.intp]


@dataclass(frozen=True)
class Width:
    """The noise of one channel from a model's residuals.

    Parameters
    ----------
    sigma: SI, root of the mean variance over all differences, so that heavy tails count.
    degrees: of freedom of sigma, fewer for heavy tails.
    law: dependence of σ on the level; None if there is none, or no other than the known one.
    """

    sigma: float
    degrees: int
    law: VarianceLaw | None


def width_off_model(
    residuals: Sequence[ModelResiduals],
    channel: int,
    *,
    correlation: float = 0.0,
    white: float = 0.0,
    step: float = 0.0,
    known: Sequence[Floats] | None = None,
) -> Width | None:
    """The standard deviation of one channel's noise, and its dependence on the level; None if undetermined.

    Squared differences of a model's residuals, ``v_i = (wᵀr_i)²/(wᵀRw)``, R the correlation of the noise,
    contain nothing of a misfit that is smooth over their few samples. Of the orders 2 and 4 the lowest is
    used whose mean square agrees with that of the next one, as it does for noise but not for a smooth misfit.
    For noise with the variance ``σ²(y) = a² + s·x + b²·x²``, x the distance of the model's level y from an
    end of its range or from 0, v_i has the mean ``Σ_j w_j²·σ²(y_j)/Σ_j w_j²``. The law is the one of highest
    likelihood without negative terms; a term is included if it raises 2·ln L by more than 15, taking the
    overlap of the differences into account. There is no law if σ hardly varies, if the median of the
    differences with large σ is smaller than predicted (a misfit at some edges), or if the next order
    disagrees in a third of the range.

    Only a variance is learned: the mean of the residuals, or its changes, do not enter.

    Parameters
    ----------
    correlation, white: of the noise, as in `ChannelNoise`.
    step: SI, of the channel's converter; noise that is smaller than it anywhere has no law.
    known: (n) of each record, σ (SI) by the previous law; a new one must be more likely by as much as a term.

    Source: Davidian & Carroll, J. Am. Stat. Assoc. 82 (1987) 1079 (variance functions); Rocke & Durbin, J.
    Comput. Biol. 8 (2001) 557 (noise at rest and a share of the level); Gasser, Sroka & Jennen-Steinmetz,
    Biometrika 73 (1986) 625 (differences).
    """
    # Orders rise until two agree: a misfit that is smooth over their few samples is then gone, and only noise
    # left.
    orders = [_differences(residuals, channel, order, correlation, white, known) for order in _ORDERS]
    pairs = pairwise(orders)
    both = next(((one, next_one) for one, next_one in pairs if _alike(one.squares, next_one.squares)), None)
    if both is None:
        return None
    differences, check = both
    law, mean = _law(differences, step)
    if law is not None and not (_borne_out(law, mean, differences, check) and _better(mean, differences)):
        law = None
    # Heavy tails: the variance of a mean square grows with the kurtosis, so that degrees of freedom shrink.
    relative = differences.squares / mean
    tails = max(_NORMAL, float(np.mean(relative**2)) / float(np.mean(relative)) ** 2)
    degrees = int(differences.degrees * differences.squares.size * (_NORMAL - 1.0) / (tails - 1.0))
    return Width(float(np.sqrt(differences.squares.mean())), degrees, law)


@dataclass(frozen=True)
class _Differences:
    """(m) squared differences of unit gain, (m, order + 1) the levels in each and the previous variance.

    `share` is the weight of each of their samples in the variance, `degrees` the degrees of freedom of each
    square.
    """

    squares: Floats
    levels: Floats
    known: Floats
    share: Floats
    degrees: float

    def means(self, law: VarianceLaw) -> Floats:
        """(m) expectation of each square."""
        return np.asarray(law.sigma(self.levels, np.zeros(1)) ** 2 @ self.share)


def _differences(
    residuals: Sequence[ModelResiduals],
    channel: int,
    order: int,
    correlation: float,
    white: float,
    known: Sequence[Floats] | None,
) -> _Differences:
    weights = difference_weights(order, correlation, white)
    parts = list(_windows(residuals, channel, order, known))
    errors, levels, sigma = (
        np.concatenate([part[i] for part in parts]) if parts else np.empty((0, order + 1)) for i in range(3)
    )
    share = weights**2 / float(weights @ weights)
    degrees = difference_degrees(weights, correlation, white, _STRETCH) / (_STRETCH - order)
    return _Differences((errors @ weights) ** 2, levels, sigma**2, share, degrees)


def _windows(
    residuals: Sequence[ModelResiduals], channel: int, order: int, known: Sequence[Floats] | None
) -> Iterator[tuple[Floats, Floats, Floats]]:
    """(windows, order + 1) errors, levels and known σ of each stretch of readings inside a phase."""
    for index, one in enumerate(residuals):
        # a channel that most rows are without has rows of its own
        read = np.isfinite(one.errors[:, channel])
        used = np.flatnonzero(read) if read.mean() < _SPARSE else np.arange(read.size)
        if used.size <= order:
            continue
        columns = one.errors[used, channel], one.levels[used, channel]
        sigma, phase = np.ones(used.size) if known is None else known[index][used], one.phase[used]
        rows = [np.lib.stride_tricks.sliding_window_view(x, order + 1) for x in (*columns, sigma)]
        good = np.isfinite(rows[0]).all(axis=1) & (phase[order:] == phase[:-order])
        yield rows[0][good], rows[1][good], rows[2][good]


def _alike(one: Floats, other: Floats) -> bool:
    """Whether there are enough of both, and their means agree."""
    if min(one.size, other.size) < _FEWEST or not one.mean() > 0.0:
        return False
    return bool(1.0 / _AGREE < other.mean() / one.mean() < _AGREE)


def _law(differences: _Differences, step: float) -> tuple[VarianceLaw | None, Floats]:
    """The most likely law with significant terms, and its prediction for each square; None for a constant."""
    least = np.full(differences.squares.size, float(differences.squares.mean()))
    best, law = _cost(least, differences) + _PAYS, None
    low, high = float(differences.levels.min()), float(differences.levels.max())
    if not high > low:
        return None, least
    # Noise may grow from either end of the range, or from zero; for each origin a linear, a quadratic, or
    # both.
    origins = (low, high, 0.0) if low < 0.0 < high else (low, high)
    for origin in origins:
        span = max(high - origin, origin - low)
        distance = np.abs(differences.levels - origin) / span
        terms = np.column_stack(
            [np.ones(least.size), distance @ differences.share, distance**2 @ differences.share]
        )
        for columns in ((0, 1), (0, 2), (0, 1, 2)):
            squares = np.zeros(3)
            squares[list(columns)] = _trimmed(terms[:, columns], differences)
            squares[0] = max(squares[0], _SMALLEST * float(least[0]))
            mean = terms @ squares
            cost = _cost(mean, differences) + _PAYS * len(columns)
            if cost < best and squares[0] >= step**2:
                best, least = cost, mean
                floor, level = np.sqrt(squares[[0, 2]]).tolist()
                degrees = int(differences.degrees * mean.size)
                law = VarianceLaw(floor, level / span, 0.0, origin, degrees, float(squares[1]) / span)
    return law, least


def _trimmed(terms: Floats, differences: _Differences) -> Floats:
    """The squares of highest likelihood over the differences that agree with them; a few are not noise."""
    from scipy.special import chdtr, chdtri

    most = float(chdtri(1, _TRIMMED))
    inliers = np.ones(differences.squares.size, bool)
    for _ in range(_ROUNDS):
        squares = most_likely_squares(terms[inliers], differences.squares[inliers])
        stay = differences.squares <= most * np.maximum(terms @ squares, 1e-300)
        if stay.sum() < _FEWEST or np.array_equal(stay, inliers):
            break
        inliers = stay
    # the truncated part of χ² below a bound has a mean below 1
    return np.asarray(squares * chdtr(1, most) / chdtr(3, most))


def _cost(mean: Floats, differences: _Differences) -> float:
    """−2·ln L of the mean of each square, with the degrees of freedom reduced by the overlap."""
    return differences.degrees * float(np.sum(np.log(mean) + differences.squares / mean))


def _better(mean: Floats, differences: _Differences) -> bool:
    """Whether a law is more likely than the previous σ, scaled to these differences."""
    known = differences.known @ differences.share
    known = known * float(np.mean(differences.squares / known))
    return _cost(mean, differences) + _PAYS < _cost(known, differences)


def _borne_out(law: VarianceLaw, mean: Floats, differences: _Differences, check: _Differences) -> bool:
    """Whether enough differences have a large σ, most as large as predicted, confirmed by the next order."""
    from scipy.special import gammaincinv

    wide = mean > _WIDER**2 * mean.min()
    if wide.sum() < max(_FEWEST // 2, _OFTEN * wide.size):
        return False
    ratio = float(np.median(differences.squares[wide] / mean[wide])) / float(2.0 * gammaincinv(0.5, 0.5))
    if not 1.0 / _MIDDLE < ratio < _MIDDLE:
        return False
    expected = check.means(law)
    parts = np.array_split(np.argsort(expected), _PARTS)
    ratios = np.array([check.squares[part].mean() / expected[part].mean() for part in parts])
    return bool(np.all((ratios > 1.0 / _AGREE_IN_PARTS) & (ratios < _AGREE_IN_PARTS)))
