"""Windows: short pieces of the records that noise is estimated from, with their trend taken out."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.record import NoiseRecord

#: samples of a window; long enough to show a correlation of 0.95, short enough for a low-order trend
LENGTH = 40
#: a shorter piece says nothing about correlation
SHORTEST = 12
#: the rest at the front of a phase becomes a window of its own from this length on
_REST = 20
#: order of the polynomial that stands for the signal inside a window
TREND_ORDER = 2
#: a window of which less than this share is left after spikes and gaps is not used
_LEFT = 0.6
#: windows with gaps have a likelihood of their own each; more patterns than this add time, not knowledge
_PATTERNS = 120

#: where in the records a window lies: phase, and how many windows before the phase's end
Cell = tuple[int, int]


@dataclass(frozen=True)
class WindowGroup:
    """Windows sampled at the same places, with the trend already projected out.

    With X the polynomials at the samples and K an orthonormal basis of what is orthogonal to X, `rows` holds
    ``u = Kᵀ·e``: whatever the trend was, ``Cov u = σ²·Kᵀ·R·K``.

    Parameters
    ----------
    places: (samples) times in units of the spacing.
    complement: (samples, degrees) K.
    rows: (windows, degrees) u, SI.
    cells: (windows) index of the cell of each window.
    conditions: (windows) the condition of each window's record.
    """

    places: NDArray[np.float64]
    complement: NDArray[np.float64]
    rows: NDArray[np.float64]
    cells: NDArray[np.intp]
    conditions: NDArray[np.intp]

    def only(self, chosen: NDArray[np.bool_]) -> WindowGroup:
        """The group with the chosen windows only."""
        return WindowGroup(
            self.places, self.complement, self.rows[chosen], self.cells[chosen], self.conditions[chosen]
        )


def cut_windows(
    records: Sequence[NoiseRecord], ok: Sequence[NDArray[np.bool_]], channel: int, spacing: float
) -> tuple[list[WindowGroup], list[Cell]]:
    """One channel of all records, cut into windows that end with their phase; and the cells they lie in."""
    found: dict[tuple[float, ...], list[tuple[NDArray[np.float64], int, int]]] = defaultdict(list)
    cells: dict[Cell, int] = {}
    for record, kept in zip(records, ok, strict=True):
        for phase, nth, first, last in _pieces(record.phase):
            use = first + np.flatnonzero(kept[first:last, channel])
            if use.size < max(SHORTEST, _LEFT * (last - first)):
                continue
            places = np.round((record.times[use] - record.times[use[0]]) / spacing, 1)
            cell = cells.setdefault((phase, nth), len(cells))
            found[tuple(places.tolist())].append((record.values[use, channel], cell, record.condition))
    patterns = sorted(found, key=lambda pattern: -len(found[pattern]))[:_PATTERNS]
    return [_group(pattern, found[pattern]) for pattern in patterns], list(cells)


def _pieces(phase: NDArray[np.intp]) -> list[tuple[int, int, int, int]]:
    """(phase, how many before its end, first sample, one past the last) of every window of a record."""
    edges = [0, *(np.flatnonzero(np.diff(phase)) + 1).tolist(), phase.size]
    pieces = []
    for begin, end in pairwise(edges):
        number, last, nth = int(phase[begin]), end, 0
        while last - begin >= LENGTH:
            pieces.append((number, nth, last - LENGTH, last))
            last, nth = last - LENGTH, nth + 1
        if last - begin >= (_REST if nth else SHORTEST):
            pieces.append((number, nth, begin, last))
    return pieces


def _group(
    pattern: tuple[float, ...], members: Sequence[tuple[NDArray[np.float64], int, int]]
) -> WindowGroup:
    places = np.array(pattern)
    centred = 2.0 * places / places[-1] - 1.0
    trend = np.polynomial.legendre.legvander(centred, TREND_ORDER)
    complement = np.linalg.qr(trend, mode="complete")[0][:, trend.shape[1] :]
    values = np.stack([value for value, _, _ in members])
    # the level is taken off first, so that nothing is lost to rounding on 300 K with noise of 1 mK
    rows = (values - values.mean(axis=1, keepdims=True)) @ complement
    cells = np.array([cell for _, cell, _ in members], np.intp)
    conditions = np.array([condition for _, _, condition in members], np.intp)
    return WindowGroup(places, complement, rows, cells, conditions)


def contrasts(groups: Sequence[WindowGroup]) -> list[WindowGroup]:
    """Differences between replicates: what records of one condition do not have in common.

    Of m windows of one cell and one condition the m − 1 Helmert contrasts
    ``(Σ_(i<k) u_i − k·u_k)/√(k·(k + 1))`` have the covariance of a single window, and the signal they share
    is gone whatever its shape.
    """
    made = []
    for group in groups:
        members: dict[tuple[int, int], list[int]] = defaultdict(list)
        for i, key in enumerate(zip(group.cells.tolist(), group.conditions.tolist(), strict=True)):
            members[key].append(i)
        rows, cells, conditions = [], [], []
        for (cell, condition), which in members.items():
            for k in range(1, len(which)):
                before = group.rows[which[:k]].sum(axis=0)
                rows.append((before - k * group.rows[which[k]]) / np.sqrt(k * (k + 1.0)))
                cells.append(cell)
                conditions.append(condition)
        if rows:
            made.append(
                WindowGroup(
                    group.places,
                    group.complement,
                    np.stack(rows),
                    np.array(cells, np.intp),
                    np.array(conditions, np.intp),
                )
            )
    return made
