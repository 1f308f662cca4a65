"""Does an effect predict data that it was not fitted to? One temperature, pressure or run is left out at a
time.

In: a linearisation at a refit with the effect among its nuisances. Out: a `CrossValidation`. The residuals
without the effect are ``r + S·φ̂`` at that point, and the fit of every fold is a small linear one: with and
without the effect, for each fold, refits of the whole model would take minutes. Where the linear problem
predicts a significant loss, the fold is repeated with refits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import FOLD_LOSS, FOLD_SEEN, FOLDS_GAIN
from rigctl.analysis.linear.linearisation import Linearisation
from rigctl.analysis.linear.nuisance_projection import least_share

Floats = NDArray[np.float64]
#: the sums of squares left on the records of a fold (indices among the fitted ones) without and with an
#: effect, by fits to the other records; None if there are none
Refitted: TypeAlias = Callable[[Sequence[int]], tuple[float, float] | None]


@dataclass(frozen=True)
class CrossValidation:
    """The cross-validation of an effect.

    Attributes
    ----------
    before, after: noise-normalised RMSE on the records left out, without and with the effect.
    mean, error: mean gain in squares per fold, and its standard error.
    folds: number of folds.
    sure, least: the sum of all gains and the least gain, each in standard deviations: that of a gain is 2‖p‖,
        p being the difference between the predictions with and without the effect.
    """

    before: float
    after: float
    mean: float
    error: float
    folds: int
    sure: float = 0.0
    least: float = 0.0

    @property
    def possible(self) -> bool:
        """True if records could be left out at least twice, with the others still determining the effect."""
        return self.folds >= 2

    @property
    def passed(self) -> bool:
        """True if the mean gain exceeds two standard errors; not every fold need gain.

        Or if the sum of all gains is significant, and no fold's loss is: an effect that acts in a few
        conditions only gains in these, and its gains scatter by as much as their mean.
        """
        steady = self.mean > 2.0 * self.error
        return self.possible and (steady or (self.sure > FOLDS_GAIN and self.least > FOLD_LOSS))


def held_out_gain(
    lin: Linearisation,
    columns: Sequence[str],
    values: Sequence[float] | Floats,
    held: Sequence[Floats] | None = None,
    refitted: Refitted | None = None,
) -> CrossValidation:
    """Cross-validated gains of the effect parameters `columns`, which are among the nuisances of `lin`.

    Parameters
    ----------
    values: of the parameters less their null, at the linearisation's point.
    held: (rows of each record) the contribution of the effect's parameters at bounds, which no fit moves.
    refitted: called for a fold that the linear problem predicts wrongly: without its records the unknowns may
        move farther than the linearisation holds.
    """
    indices = [lin.nuisances.index(name) for name in columns if name in lin.nuisances]
    amplitudes = np.array(
        [value for name, value in zip(columns, values, strict=True) if name in lin.nuisances]
    )
    every = list(range(len(lin.nuisances)))
    rest = [k for k in every if k not in indices]
    # The linearisation is at the fit *with* the effect: its residual is r. Without the effect the residual
    # there is r + S·φ̂ (`off`), and the fit without it may move the other nuisances (`rest`) to compensate.
    residuals = [record.residual for record in lin.records]
    off = [record.residual + record.nuisance[:, indices] @ amplitudes for record in lin.records]
    if held is not None:
        off = [one + more for one, more in zip(off, held, strict=True)]
    before, after, rows, gains, spreads = 0.0, 0.0, 0, [], []
    for outside in _folds(lin):
        inside = [k for k in range(len(lin.records)) if k not in outside]
        if not _determined(lin, inside, indices, amplitudes):
            continue
        # Both are fitted to the records inside, by small linear problems, and compared on those outside.
        # Record-level unknowns of the latter are projected off as in any record, since no model
        # predicts how a valve was set.
        with_it = _outside_residuals(lin, residuals, inside, outside, every)
        without = _outside_residuals(lin, off, inside, outside, rest)
        squares = float(without @ without), float(with_it @ with_it)
        # gain = ‖r_without‖² − ‖r_with‖²; with p the difference of the two predictions its standard deviation
        # is 2‖p‖.
        spread = 2.0 * float(np.linalg.norm(without - with_it))
        if refitted is not None and squares[0] - squares[1] < FOLD_LOSS * spread:
            squares = refitted(outside) or squares
        gains.append(squares[0] - squares[1])
        spreads.append(spread)
        before, after = before + squares[0], after + squares[1]
        rows += sum(lin.records[k].count for k in outside)
    if len(gains) < 2 or not rows:
        return CrossValidation(math.nan, math.nan, 0.0, 0.0, len(gains))
    return CrossValidation(
        before=math.sqrt(before / rows),
        after=math.sqrt(after / rows),
        mean=float(np.mean(gains)),
        error=float(np.std(gains, ddof=1)) / math.sqrt(len(gains)),
        folds=len(gains),
        sure=sum(gains) / max(math.hypot(*spreads), 1e-12),
        least=min(gain / spread if spread else 0.0 for gain, spread in zip(gains, spreads, strict=True)),
    )


def _determined(
    lin: Linearisation, inside: Sequence[int], indices: Sequence[int], amplitudes: Floats
) -> bool:
    """Whether the remaining records determine the effect's parameters at all.

    Without its only hot rows a table does not determine the effect of temperature and predicts nothing; nor
    do records below the threshold at which an effect starts to act.
    """
    if not indices:
        return True
    # λ of the effect in the records inside, the other nuisances projected off, as in `Projected`; columns are
    # scaled to unit length, because the unknowns' units differ by many powers of ten.
    weight = lin.prior[0]
    matrix = np.vstack([*(lin.records[k].nuisance for k in inside), weight])
    rest = [k for k in range(matrix.shape[1]) if k not in indices]
    lengths = np.linalg.norm(matrix, axis=0)
    scaled = matrix / np.where(lengths > 0.0, lengths, 1.0)
    independent = scaled[:, indices]
    if rest:
        independent = (
            independent - scaled[:, rest] @ np.linalg.lstsq(scaled[:, rest], independent, rcond=1e-8)[0]
        )
    if not lin.fit.problem.measurements.table:
        return float(np.linalg.norm(independent @ (lengths[indices] * amplitudes))) > FOLD_SEEN
    full_columns = np.vstack([one.nuisance for one in lin.records])[:, indices]
    shares = np.linalg.norm(independent, axis=0) * lengths[indices]
    return bool(np.all(shares > least_share(lin.fit) * np.linalg.norm(full_columns, axis=0)))


def _folds(lin: Linearisation) -> Iterator[tuple[int, ...]]:
    """One value of each operating variable at a time; one run at a time if there are several."""
    records = [lin.fit.problem.records[k] for k in lin.fit.fitted]
    seen: set[tuple[int, ...]] = set()
    keys: list[list[object]] = [
        [float(value) for value in lin.regions.conditions[:, column]]
        for column in range(lin.regions.conditions.shape[1])
    ]
    keys.append([record.run for record in records])
    if not any(len(set(key)) > 1 for key in keys):
        keys.append([record.label for record in records])
    for key in keys:
        for value in dict.fromkeys(key):
            fold = tuple(k for k, its in enumerate(key) if its == value)
            if len(fold) < len(records) and fold not in seen:
                seen.add(fold)
                yield fold


def _outside_residuals(
    lin: Linearisation,
    residuals: Sequence[Floats],
    inside: Sequence[int],
    outside: Sequence[int],
    free: Sequence[int],
) -> Floats:
    """(rows) residuals of the records `outside` after a fit of the nuisances `free` to the records
    `inside`."""
    weight, prior = lin.prior
    matrix = np.vstack([*(lin.records[k].nuisance for k in inside), weight])
    right = np.concatenate([*(residuals[k] for k in inside), prior])
    free_columns = matrix[:, free]
    lengths = np.linalg.norm(free_columns, axis=0)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    step = np.linalg.lstsq(free_columns / scale, right, rcond=1e-8)[0] / scale
    return np.concatenate([residuals[k] - lin.records[k].nuisance[:, free] @ step for k in outside])
