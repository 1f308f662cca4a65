"""Does an effect predict what it was not fitted on? One temperature, pressure or run left out at a time.

On the linearised problem at the refitted point: there the readings without the effect are
``r + S·φ̂``, and every fold's fit is a small linear one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.levels import FOLD_LOSS, FOLD_SEEN, FOLDS_GAIN
from rigctl.analysis.linearisation import Linearisation
from rigctl.analysis.nuisance_projection import HIDDEN

Floats = NDArray[np.float64]
#: the squares that are left on the records of a fold (places among the fitted ones) without and with an
#: effect, by fits to the others; None where there are none
Refitted: TypeAlias = Callable[[Sequence[int]], tuple[float, float] | None]


@dataclass(frozen=True)
class CrossValidation:
    """The check by leaving out.

    Attributes
    ----------
    before, after: noise-normalised RMSE on what was left out, without and with the effect.
    mean, error: of the gain in squares per fold, and its standard error.
    folds: how many.
    sure, least: all gains together, and the least of a fold, in standard deviations of what noise makes of
        them: that of a gain is 2‖p‖, p the difference of what is predicted with and without the effect.
    """

    before: float
    after: float
    mean: float
    error: float
    folds: int
    sure: float = 0.0
    least: float = 0.0

    @property
    def passed(self) -> bool:
        """The mean gain exceeds two standard errors; every fold need not gain.

        Or all gains together are no chance, and no fold's loss is more than one: an effect that acts in a few
        conditions only gains there alone, and its gains scatter by as much as they are.
        """
        steady = self.mean > 2.0 * self.error
        return self.folds >= 2 and (steady or (self.sure > FOLDS_GAIN and self.least > FOLD_LOSS))


def held_out_gain(
    lin: Linearisation,
    columns: Sequence[str],
    values: Sequence[float] | Floats,
    held: Sequence[Floats] | None = None,
    refitted: Refitted | None = None,
) -> CrossValidation:
    """Leave-out gains of the effect parameters `columns`, which are among the nuisances of `lin`.

    Parameters
    ----------
    values: of the parameters less their null, at the linearisation's point.
    held: (rows of each record) what the effect's parameters at their bounds do, which no fit moves.
    refitted: asked of a fold that the linear problem says is predicted wrongly: without its records the
        unknowns may have further to go than slopes hold for.
    """
    indices = [lin.nuisances.index(name) for name in columns if name in lin.nuisances]
    amplitudes = np.array(
        [value for name, value in zip(columns, values, strict=True) if name in lin.nuisances]
    )
    every = list(range(len(lin.nuisances)))
    rest = [k for k in every if k not in indices]
    here = [record.residual for record in lin.records]
    off = [record.residual + record.nuisance[:, indices] @ amplitudes for record in lin.records]
    if held is not None:
        off = [one + more for one, more in zip(off, held, strict=True)]
    before, after, rows, gains, spreads = 0.0, 0.0, 0, [], []
    for outside in _folds(lin):
        inside = [k for k in range(len(lin.records)) if k not in outside]
        if not _determined(lin, inside, indices, amplitudes):
            continue
        with_it = _left(lin, here, inside, outside, every)
        without = _left(lin, off, inside, outside, rest)
        squares = float(without @ without), float(with_it @ with_it)
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
    """Whether the records that are left tell the effect's parameters at all.

    Without its only hot rows a table says nothing of what heat does, and predicts nothing; nor do records
    below the threshold at which an effect begins.
    """
    if not indices:
        return True
    weight = lin.prior[0]
    matrix = np.vstack([*(lin.records[k].nuisance for k in inside), weight])
    rest = [k for k in range(matrix.shape[1]) if k not in indices]
    lengths = np.linalg.norm(matrix, axis=0)
    scaled = matrix / np.where(lengths > 0.0, lengths, 1.0)
    left = scaled[:, indices]
    if rest:
        left = left - scaled[:, rest] @ np.linalg.lstsq(scaled[:, rest], left, rcond=1e-8)[0]
    if not lin.fit.problem.measurements.table:
        return float(np.linalg.norm(left @ (lengths[indices] * amplitudes))) > FOLD_SEEN
    whole = np.vstack([one.nuisance for one in lin.records])[:, indices]
    shares = np.linalg.norm(left, axis=0) * lengths[indices]
    return bool(np.all(shares > HIDDEN * np.linalg.norm(whole, axis=0)))


def _folds(lin: Linearisation) -> Iterator[tuple[int, ...]]:
    """One value of each operating variable at a time; one run at a time where there are several."""
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


def _left(
    lin: Linearisation,
    residuals: Sequence[Floats],
    inside: Sequence[int],
    outside: Sequence[int],
    free: Sequence[int],
) -> Floats:
    """(rows) what is left on `outside` after the nuisances `free` were fitted on `inside`."""
    weight, prior = lin.prior
    matrix = np.vstack([*(lin.records[k].nuisance for k in inside), weight])
    right = np.concatenate([*(residuals[k] for k in inside), prior])
    moved = matrix[:, free]
    lengths = np.linalg.norm(moved, axis=0)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    step = np.linalg.lstsq(moved / scale, right, rcond=1e-8)[0] / scale
    return np.concatenate([residuals[k] - lin.records[k].nuisance[:, free] @ step for k in outside])
