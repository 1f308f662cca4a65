"""Does a course of values change? A scan over all ways to cut it, and what chance makes of that scan.

The values x_1 … x_N of one quantity, a run each, in the order of the date or of whatever they are looked at
over, are replaced by normal scores of their ranks, ``q = Φ⁻¹((rank − ½)/N)`` within ±1. Scanned are all ends
n and, for each of them, a step after every run k and the straight line through the first n: of the squares of
q about their mean the share R² that it explains, as the root of a likelihood ratio,

    Z = √(−(n − 3/2)·ln(1 − R²))

The statistic is the largest of all. So it pays for every run on which a change could have begun and for every
run after which it could have been seen.

What chance makes of it is drawn (`rigctl.monitoring.chance`), with neighbours that may be alike. Sequences
without correlation have the same ranks whatever the scatter from run to run is drawn from: of an outlier only
its side counts.

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

#: clear steps whose median is the clearest that is promised
_CLEAR: Final = 101


@dataclass(frozen=True)
class Scan:
    """What the scan of one course found.

    Attributes
    ----------
    statistic: the largest size of all.
    p_value: how often chance reaches it, this course alone.
    correlation: how alike neighbours look, with no change in it.
    ends, at_ends: the numbers of runs after which it was looked, and the largest size up to there.
    """

    statistic: float
    p_value: float
    correlation: float
    ends: tuple[int, ...]
    at_ends: tuple[float, ...]

    def first_end(self, least: float) -> int | None:
        """After how many runs the scan is as large as `least` for the first time; None where it never is."""
        return next((n for n, size in zip(self.ends, self.at_ends, strict=True) if size >= least), None)


def scan(values: Floats, over: Floats, *, draws: int = FINE) -> Scan:
    """Scan a course of values.

    Parameters
    ----------
    values: (runs) in the order of `over`, finite.
    over: (runs) where each run lies; between runs at the same place nothing can have changed.
    draws: as of `rigctl.monitoring.chance.chance`.
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
    """The size that chance exceeds with probability `level`; infinite where no draw says."""
    return chance(over.size, apart_in(over)).critical(level, correlation)


def best_possible(over: Floats) -> float:
    """The p-value of the clearest step there is: every value after the middle lies above all before it.

    Within the halves the order is chance; it is the median of such courses.
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
