"""Does a series of values change? A scan over all change points and end points.

The values x_1 … x_N of one quantity, one for each run, ordered by date or another variable, are replaced by
normal scores of their ranks, ``q = Φ⁻¹((rank − ½)/N)``, clipped to ±1. For every end n, the scan fits a step
after every run k and a straight line through the first n; with R² the explained share of the squares of q
about their mean, the signed root of the likelihood ratio is

    Z = √(−(n − 3/2)·ln(1 − R²))

The statistic is the largest of all. It thus accounts for every run at which a change could have started and
for every run after which it could have been detected.

Its null distribution is simulated (`rigctl.monitoring.significance`), with neighbours that may be correlated.
For uncorrelated sequences the ranks do not depend on the distribution of the scatter: of an outlier only its
side counts.

Sources: A. N. Pettitt, Appl. Statist. 28 (1979) 126 (ranks, an unknown change point); the end is scanned too,
as in sequential detection (D. Siegmund, Sequential Analysis, 1985).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
#: True after runs at which a change is possible; None if after any
PossibleChanges = tuple[bool, ...] | None

#: least number of runs on either side of a change
FEWEST_BESIDE: Final = 3
#: largest numbers of ends, and of change points for each, that are scanned
_ENDS: Final = 120
_CUTS: Final = 40


def possible_changes(over: Floats) -> PossibleChanges:
    """After which runs a change is possible: before runs at another location; None if after any."""
    apart = tuple(bool(step > 0.0) for step in np.diff(over))
    return None if all(apart) else apart


def sizes(scores: Floats, apart: PossibleChanges) -> tuple[tuple[int, ...], Floats]:
    """The ends that are scanned, and (courses, ends) the largest size at each of them."""
    count = scores.shape[1]
    # Cumulative sums of q, q² and i·q: every step and every line of every end costs a few differences of
    # them.
    sums, squares = np.cumsum(scores, axis=1), np.cumsum(np.square(scores), axis=1)
    moments = np.cumsum(scores * np.arange(1, count + 1, dtype=float), axis=1)
    ends, largest = [], []
    for n in _ends(count):
        cuts = cuts_of(n, apart)
        if not cuts.size:
            continue
        total = sums[:, n - 1]
        spread = np.maximum(squares[:, n - 1] - total * total / n, 1e-12)
        before = sums[:, cuts - 1]
        # Explained by a step after run k: d²/(1/k + 1/(n − k)), with d the difference of the means; by a
        # line: (Σ (i − ī)·q)²/(n(n² − 1)/12). The larger one over the squares about the mean is R².
        difference = (total[:, None] - before) / (n - cuts) - before / cuts
        explained = np.max(np.square(difference) / (1.0 / cuts + 1.0 / (n - cuts)), axis=1)
        line = np.square(moments[:, n - 1] - 0.5 * (n + 1) * total) / (n * (n * n - 1.0) / 12.0)
        share = np.minimum(np.maximum(explained, line) / spread, 1.0 - 1e-9)
        ends.append(n)
        largest.append(np.sqrt(-(n - 1.5) * np.log1p(-share)))
    return tuple(ends), np.stack(largest, axis=1) if largest else np.empty((scores.shape[0], 0))


def _ends(count: int) -> list[int]:
    """The numbers of runs at which the scan ends, including the last."""
    first = 2 * FEWEST_BESIDE
    if count < first:
        return []
    every = np.linspace(first, count, min(count - first + 1, _ENDS))
    return sorted({round(float(n)) for n in every})


@lru_cache(maxsize=8192)
def cuts_of(n: int, apart: PossibleChanges) -> Indices:
    """After which of the first n runs a change is tried, more densely near both ends."""
    first, last = FEWEST_BESIDE, n - FEWEST_BESIDE
    if last - first + 1 <= _CUTS:
        cuts = np.arange(first, last + 1)
    else:
        half = np.geomspace(first, 0.5 * n, _CUTS // 2)
        cuts = np.unique(np.round(np.concatenate([half, n - half])).astype(np.intp))
    if apart is not None:
        cuts = cuts[np.array(apart)[cuts - 1]]
    return cuts
