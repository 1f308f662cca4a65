"""Windows: short pieces of the records for estimating noise, with their trend removed.

In: one channel of all records. Out: `WindowGroup`s, each of windows with equal sampling, for which a
likelihood costs one factorisation. A window lies within a period of constant commands and is counted from
its end, so that the same window of another record shows the same part of the procedure.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.record import NoiseRecord

#: samples in a window; long enough to show a correlation of 0.95, short enough for a low-order trend
LENGTH = 40
#: a shorter piece contains no information about correlation
SHORTEST = 12
#: least length of a remaining piece at the front of a phase that becomes a window of its own
_REST = 20
#: order of the polynomial that represents the signal inside a window
TREND_ORDER = 2
#: a window with less than this share of samples left after spikes and gaps is not used
_LEFT = 0.6
#: largest number of patterns of gaps, each of which needs its own likelihood: more take time and add little
_PATTERNS = 60

#: location of a window in the records: phase, and number of windows before the phase's end
Cell = tuple[int, int]


@dataclass(frozen=True)
class WindowGroup:
    """Windows of one channel with the same sampling pattern.

    Parameters
    ----------
    positions: (samples) times in units of the spacing.
    trend: (samples, orders) the polynomials that represent the signal.
    rows: (windows, samples) SI, each less its mean.
    cells: (windows) index of the cell of each window.
    conditions: (windows) the condition of each window's record.
    levels: (windows, samples) SI, the signal according to its trend, relative to an occurring value.
    """

    positions: NDArray[np.float64]
    trend: NDArray[np.float64]
    rows: NDArray[np.float64]
    cells: NDArray[np.intp]
    conditions: NDArray[np.intp]
    levels: NDArray[np.float64]

    @property
    def degrees(self) -> int:
        """Degrees of freedom of one window after removing its trend."""
        return int(self.trend.shape[0] - self.trend.shape[1])

    @property
    def total_degrees(self) -> int:
        """Degrees of freedom of all its windows."""
        return self.degrees * int(self.rows.shape[0])

    def only(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> WindowGroup:
        """The group with the chosen windows only."""
        return replace(
            self,
            rows=self.rows[chosen],
            cells=self.cells[chosen],
            conditions=self.conditions[chosen],
            levels=self.levels[chosen],
        )


def cut_windows(
    records: Sequence[NoiseRecord],
    ok: Sequence[NDArray[np.bool_]],
    channel: int,
    spacing: float,
    joined: Mapping[Cell, int] | None = None,
    order: int = TREND_ORDER,
) -> tuple[list[WindowGroup], list[Cell]]:
    """One channel of all records, cut into windows counted from the end of each phase.

    Parameters
    ----------
    joined: number of consecutive windows, from the given cell towards the front, that form one long window.
    order: of the polynomial that represents the signal inside a window.

    Returns
    -------
    groups of windows with equal sampling, and the cells to which their `cells` are indices.
    """
    windows: dict[tuple[float, ...], list[tuple[NDArray[np.float64], int, int]]] = defaultdict(list)
    cells: dict[Cell, int] = {}
    for record, good in zip(records, ok, strict=True):
        # Counted from the end of a phase, where a bench has settled: windows with the same number are
        # comparable between records, whatever the length of the phase.
        for phase, nth, first, last in _pieces(record.phase, joined or {}):
            use = first + np.flatnonzero(good[first:last, channel])
            if use.size < max(SHORTEST, _LEFT * (last - first)):
                continue
            positions = (record.times[use] - record.times[use[0]]) / spacing
            rounded = np.round(positions, 1)  # windows of nearly equal sampling are estimated together
            if (np.diff(rounded) > 0.0).all():  # irregular samples may be closer, and must stay distinct
                positions = rounded
            cell = cells.setdefault((phase, nth), len(cells))
            windows[tuple(positions.tolist())].append((record.values[use, channel], cell, record.condition))
    patterns = sorted(windows, key=lambda pattern: -len(windows[pattern]))[:_PATTERNS]
    return [_group(pattern, windows[pattern], order) for pattern in patterns], list(cells)


def _pieces(phase: NDArray[np.intp], joined: Mapping[Cell, int]) -> list[tuple[int, int, int, int]]:
    """(phase, number before its end, first sample, one past the last) of every window of a record."""
    if phase.size == 0:
        return []
    edges = [0, *(np.flatnonzero(np.diff(phase)) + 1).tolist(), phase.size]
    pieces = []
    for begin, end in pairwise(edges):
        number, last, nth = int(phase[begin]), end, 0
        while last - begin >= LENGTH:
            together = min(joined.get((number, nth), 1), (last - begin) // LENGTH)
            pieces.append((number, nth, last - together * LENGTH, last))
            last, nth = last - together * LENGTH, nth + together
        if last - begin >= (_REST if nth else SHORTEST):
            pieces.append((number, nth, begin, last))
    return pieces


def window_pieces(phase: NDArray[np.intp]) -> list[tuple[int, int]]:
    """(first sample, one past the last) of every window of a record; `phase` (n) as in `NoiseRecord`."""
    return [(first, last) for _, _, first, last in _pieces(phase, {})]


def _group(
    pattern: tuple[float, ...], members: Sequence[tuple[NDArray[np.float64], int, int]], order: int
) -> WindowGroup:
    positions = np.array(pattern)
    polynomials = np.polynomial.legendre.legvander(2.0 * positions / positions[-1] - 1.0, order)
    trend = np.linalg.qr(polynomials)[0]
    values = np.stack([value for value, _, _ in members])
    # the level is removed first, so that nothing is lost to rounding on 300 K with noise of 1 mK
    level = values.mean(axis=1, keepdims=True)
    rows = values - level
    cells = np.array([cell for _, cell, _ in members], np.intp)
    conditions = np.array([condition for _, _, condition in members], np.intp)
    return WindowGroup(
        positions, trend, rows, cells, conditions, level - values[:, :1] + rows @ trend @ trend.T
    )


def contrasts(groups: Sequence[WindowGroup]) -> list[WindowGroup]:
    """Differences between replicates: the deviations of records of one condition from each other.

    For m windows of one cell and one condition the m − 1 Helmert contrasts
    ``(Σ_(i<k) u_i − k·u_k)/√(k·(k + 1))`` have the covariance of a single window, and the shared signal
    cancels whatever its shape.
    """
    result = []
    for group in groups:
        members: dict[tuple[int, int], list[int]] = defaultdict(list)
        for i, key in enumerate(zip(group.cells.tolist(), group.conditions.tolist(), strict=True)):
            members[key].append(i)
        rows, indices = [], []
        for which in members.values():
            for k in range(1, len(which)):
                preceding = group.rows[which[:k]].sum(axis=0)
                rows.append((preceding - k * group.rows[which[k]]) / np.sqrt(k * (k + 1.0)))
                indices.append(which[k])
        if rows:
            result.append(replace(group.only(np.array(indices, np.intp)), rows=np.stack(rows)))
    return result
