"""Does a series of values change? A scan over all change points and end points, with its null distribution.

The values x_1 … x_N of one quantity, one for each run, ordered by date or another variable, are replaced by
normal scores of their ranks, ``q = Φ⁻¹((rank − ½)/N)``, clipped to ±1. For every end n, the scan fits a step
after every run k and a straight line through the first n; with R² the explained share of the squares of q
about their mean, the signed root of the likelihood ratio is

    Z = √(−(n − 3/2)·ln(1 − R²))

The statistic is the largest of all. It thus accounts for every run at which a change could have started and
for every run after which it could have been detected.

The null distribution is simulated (`rigctl.monitoring.chance`), with neighbours that may be correlated. For
uncorrelated sequences the ranks do not depend on the distribution of the scatter: of an outlier only its side
counts.

Sources: A. N. Pettitt, Appl. Statist. 28 (1979) 126 (ranks, an unknown change point); the end is scanned too,
as in sequential detection (D. Siegmund, Sequential Analysis, 1985).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigctl.monitoring.chance import FINE, chance
from rigctl.monitoring.ranks import apart_in, neighbours, normal_scores, sizes

Floats = NDArray[np.float64]

#: number of clear steps whose median gives the smallest attainable p-value
_CLEAR: Final = 101


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
    draws: as in `rigctl.monitoring.chance.chance`.
    """
    scores = normal_scores(values)[None, :]
    apart = apart_in(over)
    correlation = float(neighbours(values[None, :], scores)[0])
    ends, found = sizes(scores, apart)
    largest = float(found.max()) if found.size else 0.0
    return Scan(
        statistic=largest,
        p_value=chance(values.size, apart, draws).p_value(largest, correlation),
        correlation=correlation,
        ends=ends,
        at_ends=tuple(float(size) for size in np.maximum.accumulate(found[0])) if found.size else (),
    )


def critical(over: Floats, correlation: float, level: float) -> float:
    """The size exceeded by chance with probability `level`; infinite if there are too few draws."""
    return chance(over.size, apart_in(over)).critical(level, correlation)


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
    scores, apart = normal_scores(courses), apart_in(over)
    _, found = sizes(scores, apart)
    if not found.size:
        return 1.0
    drawn = chance(over.size, apart)
    clear = zip(found.max(axis=1), neighbours(courses, scores), strict=True)
    return float(np.median([drawn.p_value(float(size), float(alike)) for size, alike in clear]))
