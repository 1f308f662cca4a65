"""Windows that show noise alone: those that agree with the quietest, cell by cell.

In: windows of one channel, and differences between replicates of the same. Out: the noise fitted to those
that agree (`Pooled`), or None. No window says of itself whether it holds a signal: what all quiet ones have
in common is the noise, and what is larger than that is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.noise.reml import NoiseFit, fit_noise, whitened
from rigctl.noise.windows import WindowGroup

#: probability that a window, or a cell, that holds noise alone is left out
_WINDOW_LEVEL = 1e-4
_CELL_LEVEL = 1e-3
#: share of the cells with which the search starts: the quietest
_START = 0.25
#: least degrees of freedom for estimating a correlation
FEWEST = 30
_ROUNDS = 12


@dataclass(frozen=True)
class Pooled:
    """The fit to the windows that agree, and the sources of its degrees of freedom.

    Parameters
    ----------
    quiet, replicates: degrees of freedom from the records themselves, and from differences of replicates.
    used: (cells) whether the records themselves showed noise alone there.
    """

    fit: NoiseFit
    quiet: int
    replicates: int
    used: NDArray[np.bool_]


def pool(
    groups: Sequence[WindowGroup],
    differences: Sequence[WindowGroup],
    cells: int,
    *,
    start: NoiseFit | None = None,
    tolerance: float = 1.0,
) -> Pooled | None:
    """Fit the noise to every cell that shows noise alone; None if too few are quiet.

    A cell is one place of the procedure (a phase, and a number of windows before its end) over all records.
    The search starts with the quietest quarter of the cells, fits them, adds every cell that agrees with the
    fit, and repeats until nothing changes. A cell agrees if its Σz² is no larger than the noise allows (F
    test at 0.1 %), and neither is the mean of z over the records: a remaining signal has the same shape in
    every record, noise does not. Where the records themselves do not agree, the differences between
    replicates may, and are used instead. Single outlying windows (at 0.01 %) are left out.

    Parameters
    ----------
    groups: windows of the records.
    differences: contrasts of replicates of the same cells.
    cells: number of cells.
    start: a fit to start with instead of the quietest cells.
    tolerance: factor by which the Σz² of a cell may be larger, if it is known to differ from cell to cell.
    """
    total = sum(group.total_degrees for group in groups)
    if total < FEWEST or not any(np.any(group.rows) for group in groups):
        return None
    # Start from the quietest quarter, fit, keep what agrees with the fit, and repeat: windows that hold a
    # signal do not agree with the quietest ones, whatever their own noise is. The rounds end when the same
    # cells return.
    chosen = _taken(groups, differences, *_quietest(groups, differences, cells))
    states: set[bytes] = set()
    fit = start or fit_noise(chosen.windows, white=0.0)
    white, searched = fit.white, False
    for _ in range(_ROUNDS):
        if fit.sigma == 0.0:
            return None
        agreed = _agreed(groups, differences, fit, cells, tolerance)
        if agreed is None:
            break
        chosen = agreed
        # added white noise, which takes ten fits, is estimated only once the cells no longer change
        settled = chosen.state in states
        fit = fit_noise(chosen.windows, white=None if settled else white)
        if settled:
            if searched or fit.white == white:
                break
            white, searched = fit.white, True
            states.clear()
        states.add(chosen.state)
    return Pooled(
        fit,
        sum(group.total_degrees for group in chosen.quiet),
        sum(group.total_degrees for group in chosen.replicates),
        chosen.used,
    )


@dataclass(frozen=True)
class _Taken:
    """The cells included, of the records and of their differences, and the windows left in them."""

    used: NDArray[np.bool_]
    used_differences: NDArray[np.bool_]
    quiet: list[WindowGroup]
    replicates: list[WindowGroup]

    @property
    def windows(self) -> list[WindowGroup]:
        return [*self.quiet, *self.replicates]

    @property
    def state(self) -> bytes:
        """Equal if the same cells were included."""
        return self.used.tobytes() + self.used_differences.tobytes()


def _taken(
    groups: Sequence[WindowGroup],
    differences: Sequence[WindowGroup],
    used: NDArray[np.bool_],
    used_differences: NDArray[np.bool_],
    far: Sequence[NDArray[np.bool_]] | None = None,
    far_differences: Sequence[NDArray[np.bool_]] | None = None,
) -> _Taken:
    """The windows of the cells, without outlying ones."""
    return _Taken(
        used,
        used_differences,
        _chosen(groups, used, far),
        _chosen(differences, used_differences, far_differences),
    )


def _agreed(
    groups: Sequence[WindowGroup],
    differences: Sequence[WindowGroup],
    fit: NoiseFit,
    cells: int,
    tolerance: float,
) -> _Taken | None:
    """What agrees with a fit: of the records, else of their differences; None if nothing does."""
    white = [whitened(group, fit) for group in groups]
    white_differences = [whitened(group, fit) for group in differences]
    far = [_far(z, group) for z, group in zip(white, groups, strict=True)]
    far_differences = [_far(z, group) for z, group in zip(white_differences, differences, strict=True)]
    used = _agreeing(groups, white, far, fit, cells, tolerance, means=True)
    instead = _agreeing(differences, white_differences, far_differences, fit, cells, tolerance, means=False)
    instead &= ~used
    if not (used.any() or instead.any()):
        return None
    return _taken(groups, differences, used, instead, far, far_differences)


def _quietest(
    groups: Sequence[WindowGroup], differences: Sequence[WindowGroup], cells: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The quarter of the cells with the smallest median variance, of the records or of their differences.

    More if that is too little data. Differences are used where they are quieter by half: where records move.
    """
    variance, degrees = _typical(groups, cells)
    between, between_degrees = _typical(differences, cells)
    instead = between < 0.5 * variance
    typical = np.where(instead, between, variance)
    # a constant cell (a signal below one converter step) contains no information about the others
    order = [i for i in np.argsort(typical, kind="stable").tolist() if 0.0 < typical[i] < np.inf]
    order = order or [i for i in range(cells) if typical[i] < np.inf]
    used, enough = np.zeros(cells, bool), 0.0
    for rank, cell in enumerate(order):
        if rank >= max(1.0, _START * len(order)) and enough >= FEWEST:
            break
        used[cell] = True
        enough += (between_degrees if instead[cell] else degrees)[cell]
    return used & ~instead, used & instead


def _typical(groups: Sequence[WindowGroup], cells: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(cells) median variance about the trend, SI², infinite without windows; and degrees of freedom."""
    variance: list[list[float]] = [[] for _ in range(cells)]
    degrees = np.zeros(cells)
    for group in groups:
        for cell, value in zip(group.cells.tolist(), _variance(group).tolist(), strict=True):
            variance[cell].append(value)
            degrees[cell] += group.degrees
    return np.array([np.median(each) if each else np.inf for each in variance]), degrees


def _variance(group: WindowGroup) -> NDArray[np.float64]:
    """(windows) variance about the trend, SI²."""
    away = group.rows - group.rows @ group.trend @ group.trend.T
    return np.asarray(np.sum(away**2, axis=1) / group.degrees)


def _chosen(
    groups: Sequence[WindowGroup], used: NDArray[np.bool_], far: Sequence[NDArray[np.bool_]] | None = None
) -> list[WindowGroup]:
    left_out = far or [np.zeros(group.cells.size, bool) for group in groups]
    chosen = [group.only(used[group.cells] & ~out) for group, out in zip(groups, left_out, strict=True)]
    return [group for group in chosen if group.rows.size]


def _far(z: NDArray[np.float64], group: WindowGroup) -> NDArray[np.bool_]:
    """Windows whose Σz² is too large for chance; z as `whitened` gives it."""
    from scipy.special import chdtri

    return np.asarray(np.sum(z**2, axis=1) > chdtri(group.degrees, _WINDOW_LEVEL))


def _agreeing(
    groups: Sequence[WindowGroup],
    white: Sequence[NDArray[np.float64]],
    far: Sequence[NDArray[np.bool_]],
    fit: NoiseFit,
    cells: int,
    tolerance: float,
    *,
    means: bool,
) -> NDArray[np.bool_]:
    """The cells with most of their windows left and with Σz² and mean z as expected for noise."""
    from scipy.special import fdtri

    # Two tests for each cell: Σz² as large as chance allows, and the mean of z over records no larger than
    # that of noise, since a signal that the trend does not remove has the same shape in every record.
    squares, degrees, count, remaining = (np.zeros(cells) for _ in range(4))
    mean_squares, mean_degrees = np.zeros(cells), np.zeros(cells)
    for group, z, out in zip(groups, white, far, strict=True):
        for cell in np.unique(group.cells).tolist():
            in_cell = group.cells == cell
            inliers = z[in_cell & ~out]
            count[cell] += int(in_cell.sum())
            remaining[cell] += inliers.shape[0]
            squares[cell] += float(np.sum(inliers**2))
            degrees[cell] += inliers.shape[0] * group.degrees
            if inliers.shape[0] >= 4:
                mean_squares[cell] += inliers.shape[0] * float(np.sum(inliers.mean(axis=0) ** 2))
                mean_degrees[cell] += group.degrees
    agree = remaining > 0.5 * count
    dof = np.maximum(degrees, 1.0)
    agree &= squares / dof <= tolerance * fdtri(dof, fit.degrees, 1.0 - _CELL_LEVEL)
    if means:
        dof = np.maximum(mean_degrees, 1.0)
        agree &= mean_squares / dof <= fdtri(dof, fit.degrees, 1.0 - _CELL_LEVEL)
    return np.asarray(agree)
