"""The significance of a change: the scan's null distribution for runs with an unknown autocorrelation.

Gaussian sequences without a change are simulated with autocorrelations ρ, ρ², … at lags 1, 2, … ρ itself is
random: zero for half of the sequences, as the runs of most benches are independent, and uniform between 0.1
and 0.8 for the others. For each sequence the size T of its scan and its estimated autocorrelation r
(`rigctl.monitoring.ranks`) are kept. The p-value of a series (T₀, r₀) is the share of large sizes among the
sequences with a similar r,

    p = Σ w_i [T_i ≥ T₀] / Σ w_i,   w_i = prior(ρ_i)·exp(−(r_i − r₀)²/2h²),   h = 0.1

This accounts for the uncertainty of ρ with few runs: with a single estimate in its place, up to one survey in
twelve was wrong at ρ = 0.6. Averaged over the simulated autocorrelations the level is exact; `python -m
benchmarks.survey --chance N` counts it for each.

Source: G. E. P. Box, J. R. Statist. Soc. A 143 (1980) 383 (predictive p-values), given r as in M. J. Bayarri
and J. O. Berger, J. Am. Statist. Assoc. 95 (2000) 1127.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.monitoring.change_point import PossibleChanges, possible_changes, sizes
from rigctl.monitoring.ranks import drawn_scores, neighbours, normal_scores

Floats = NDArray[np.float64]

#: largest autocorrelation considered; a slower drift counts as a change
STRONGEST: Final = 0.8
_CORRELATIONS: Final = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, STRONGEST)
#: number of sequences for each correlation, for a p-value and for a decision only; for zero this many times
#: as many
FINE, COARSE = 4_000, 500
_OF_ZERO: Final = 4
_AT_ONCE: Final = 2_000
#: bandwidth h of the kernel over the estimated autocorrelation
_WIDTH: Final = 0.1
#: number of clear steps whose median gives the smallest attainable p-value
_CLEAR: Final = 101


@dataclass(frozen=True)
class Chance:
    """Simulated sequences without a change.

    Attributes
    ----------
    sizes: (draws) of their scans, decreasing.
    alike: (draws) their estimated autocorrelations.
    prior: (draws) their weights.
    """

    sizes: Floats = field(repr=False)
    alike: Floats = field(repr=False)
    prior: Floats = field(repr=False)

    def p_value(self, size: float, alike: float) -> float:
        """Probability of as large a size for a series with this estimated autocorrelation."""
        tail = self._tail(alike)
        reached = int(np.searchsorted(-self.sizes, -size * (1.0 - 1e-12), side="right"))
        return float(tail[reached])

    def critical(self, level: float, alike: float) -> float:
        """The size exceeded by chance with probability `level`; infinite if there are too few draws."""
        enough = int(np.searchsorted(self._tail(alike), level, side="right")) - 1
        return float(self.sizes[enough - 1]) if enough >= 1 else math.inf

    def _tail(self, alike: float) -> Floats:
        """(draws + 1) the p-value of a size that so many draws reach, counting the observed one as well."""
        nearest = min(max(alike, float(np.min(self.alike))), float(np.max(self.alike)))
        weights = self.prior * np.exp(-0.5 * np.square((self.alike - nearest) / _WIDTH))
        observed = float(np.max(weights))
        return np.asarray(
            np.append(observed, observed + np.cumsum(weights)) / (observed + float(np.sum(weights)))
        )


@lru_cache(maxsize=48)
def chance(count: int, apart: PossibleChanges, draws: int = FINE) -> Chance:
    """The null distribution for `count` runs; `draws` sequences for each correlation except zero."""
    found_sizes, found_alike, prior = [], [], []
    for correlation in _CORRELATIONS:
        # Seeded by the number of runs and ρ alone: the same survey has the same p-value wherever it is
        # computed.
        generator = np.random.Generator(np.random.PCG64([20, count, round(1000 * correlation)]))
        wanted = draws * (1 if correlation else _OF_ZERO)
        each = 0.5 / wanted if correlation == 0.0 else 0.5 / (len(_CORRELATIONS) - 1) / wanted
        for first in range(0, wanted, _AT_ONCE):
            values = _sequences(generator, min(_AT_ONCE, wanted - first), count, correlation)
            scores = drawn_scores(values)
            _, every = sizes(scores, apart)
            found_sizes.append(every.max(axis=1) if every.size else np.zeros(len(scores)))
            found_alike.append(neighbours(values, scores))
            prior.append(np.full(len(scores), each))
    largest = np.concatenate(found_sizes)
    order = np.argsort(-largest, kind="stable")
    return Chance(largest[order], np.concatenate(found_alike)[order], np.concatenate(prior)[order])


def _sequences(generator: np.random.Generator, draws: int, count: int, correlation: float) -> Floats:
    """(draws, count) Gaussian sequences of mean 0 and variance 1 with this autocorrelation at lag 1."""
    noise = generator.standard_normal((draws, count))
    if correlation == 0.0:
        return noise
    share = math.sqrt(1.0 - correlation**2)
    for k in range(1, count):
        noise[:, k] = correlation * noise[:, k - 1] + share * noise[:, k]
    return noise


@dataclass(frozen=True)
class Scan:
    """The result of scanning one series.

    Attributes
    ----------
    statistic: the largest size of all.
    p_value: for this series alone.
    correlation: estimated autocorrelation at lag 1, with changes removed.
    ends, at_ends: the end points scanned (numbers of runs), and the largest size up to each.
    """

    statistic: float
    p_value: float
    correlation: float
    ends: tuple[int, ...]
    at_ends: tuple[float, ...]

    def first_end(self, least: float) -> int | None:
        """The number of runs after which the scan first reaches `least`; None if it never does."""
        return next((n for n, size in zip(self.ends, self.at_ends, strict=True) if size >= least), None)


def scan(values: Floats, over: Floats, *, draws: int = FINE) -> Scan:
    """Scan a series of values.

    Parameters
    ----------
    values: (runs) in the order of `over`, finite.
    over: (runs) location of each run on the axis; no change is possible between runs at the same location.
    draws: as in `chance`.
    """
    # The measured series undergoes exactly what the simulated ones do: ranks, scan of all ends, estimate of
    # r.
    scores = normal_scores(values)[None, :]
    apart = possible_changes(over)
    correlation = float(neighbours(values[None, :], scores)[0])
    ends, sizes_at_ends = sizes(scores, apart)
    largest = float(sizes_at_ends.max()) if sizes_at_ends.size else 0.0
    return Scan(
        statistic=largest,
        p_value=chance(values.size, apart, draws).p_value(largest, correlation),
        correlation=correlation,
        ends=ends,
        at_ends=tuple(float(size) for size in np.maximum.accumulate(sizes_at_ends[0]))
        if sizes_at_ends.size
        else (),
    )


def critical(over: Floats, correlation: float, level: float) -> float:
    """The size exceeded by chance with probability `level`; infinite if there are too few draws."""
    return chance(over.size, possible_changes(over)).critical(level, correlation)


def best_possible(over: Floats) -> float:
    """The p-value of the clearest possible step: every value after the middle exceeds all before it.

    Within the halves the order is random; the result is the median over such series.
    """
    half, generator = over.size // 2, np.random.Generator(np.random.PCG64(over.size))
    courses: Floats = np.stack(
        [
            np.concatenate([generator.permutation(half), half + generator.permutation(over.size - half)])
            for _ in range(_CLEAR)
        ]
    ).astype(float)
    scores, apart = normal_scores(courses), possible_changes(over)
    _, sizes_at_ends = sizes(scores, apart)
    if not sizes_at_ends.size:
        return 1.0
    drawn = chance(over.size, apart)
    clear = zip(sizes_at_ends.max(axis=1), neighbours(courses, scores), strict=True)
    return float(np.median([drawn.p_value(float(size), float(alike)) for size, alike in clear]))
