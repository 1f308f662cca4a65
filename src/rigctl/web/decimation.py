"""Decimation of samples to the width of a plot without losing peaks: minimum and maximum of each interval."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def envelope(rows: NDArray[np.float64], stretch: float) -> NDArray[np.float64]:
    """Rows of time and values, with two rows for each time interval that has more.

    Parameters
    ----------
    rows: shape (n, 1 + columns), the first column time in s, rising.
    stretch: s; 0 leaves all rows as they are.

    Returns
    -------
    Shape (m, 1 + columns). The two values of each column are the minimum and maximum of the interval, the
    minimum first if it rises; NaN if the interval has no value.
    """
    import numpy as np

    if stretch <= 0.0 or not len(rows):
        return rows
    number = np.floor(rows[:, 0] / stretch)
    begins = np.flatnonzero(np.r_[True, number[1:] != number[:-1]])
    ends = np.r_[begins[1:], len(rows)] - 1
    lows = np.fmin.reduceat(rows, begins, axis=0)
    highs = np.fmax.reduceat(rows, begins, axis=0)
    falls = rows[ends] < rows[begins]
    reduced = np.empty((2 * len(begins), rows.shape[1]))
    reduced[0::2] = np.where(falls, highs, lows)
    reduced[1::2] = np.where(falls, lows, highs)
    reduced[0::2, 0], reduced[1::2, 0] = rows[begins, 0], rows[ends, 0]
    single = np.flatnonzero(begins == ends)
    return np.delete(reduced, 2 * single + 1, axis=0)


class Thinning:
    """Decimates rows as they arrive; those of an unfinished interval are provisional.

    Parameters
    ----------
    stretch: s, see `envelope`.
    """

    def __init__(self, stretch: float) -> None:
        self._stretch = stretch
        self._open: NDArray[np.float64] | None = None

    def take(self, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
        """The decimated rows, and how many at their end will be replaced by the next ones."""
        import numpy as np

        if self._stretch <= 0.0 or not len(rows):
            return rows, 0
        if self._open is not None:
            rows = np.concatenate([self._open, rows])
        number = np.floor(rows[:, 0] / self._stretch)
        last = int(np.searchsorted(number, number[-1]))
        self._open = rows[last:].copy()
        closed, provisional = envelope(rows[:last], self._stretch), envelope(self._open, self._stretch)
        return np.concatenate([closed, provisional]), len(provisional)
