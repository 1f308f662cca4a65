"""Does an effect predict what it was not fitted on? One temperature, pressure or run left out at a time.

On the linearised problem at the refitted point: there the readings without the effect are
``r + S·φ̂``, and every fold's fit is a small linear one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.linearise import Linearisation
from rigctl.compare.projected import HIDDEN

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class HeldOut:
    """The check by leaving out.

    Attributes
    ----------
    before, after: noise-normalised RMSE on what was left out, without and with the effect.
    mean, error: of the gain in squares per fold, and its standard error.
    folds: how many.
    """

    before: float
    after: float
    mean: float
    error: float
    folds: int

    @property
    def passed(self) -> bool:
        """The mean gain exceeds two standard errors; every fold need not gain."""
        return self.folds >= 2 and self.mean > 2.0 * self.error


def held_out_gain(lin: Linearisation, columns: Sequence[str], values: Sequence[float]) -> HeldOut:
    """Leave-out gains of the effect parameters `columns`, which are among the nuisances of `lin`.

    Parameters
    ----------
    values: of the parameters less their null, at the linearisation's point.
    """
    places = [lin.nuisances.index(name) for name in columns if name in lin.nuisances]
    sizes = np.array([value for name, value in zip(columns, values, strict=True) if name in lin.nuisances])
    rest = [k for k in range(len(lin.nuisances)) if k not in places]
    before, after, rows, gains = 0.0, 0.0, 0, []
    for outside in _folds(lin):
        inside = [k for k in range(len(lin.records)) if k not in outside]
        if lin.fit.problem.measurements.table and not _determined(lin, inside, places):
            continue
        with_it = _loss(lin, inside, outside, list(range(len(lin.nuisances))), None)
        without = _loss(lin, inside, outside, rest, (places, sizes))
        gains.append(without - with_it)
        before, after = before + without, after + with_it
        rows += sum(lin.records[k].count for k in outside)
    if len(gains) < 2 or not rows:
        return HeldOut(math.nan, math.nan, 0.0, 0.0, len(gains))
    spread = float(np.std(gains, ddof=1)) / math.sqrt(len(gains))
    return HeldOut(
        math.sqrt(before / rows), math.sqrt(after / rows), float(np.mean(gains)), spread, len(gains)
    )


def _determined(lin: Linearisation, inside: Sequence[int], places: Sequence[int]) -> bool:
    """Whether the rows of a table that are left tell the effect's parameters at all.

    Without its only hot rows a table says nothing of what heat does, and predicts nothing.
    """
    weight = lin.prior[0]
    matrix = np.vstack([*(lin.records[k].nuisance for k in inside), weight])
    rest = [k for k in range(matrix.shape[1]) if k not in places]
    lengths = np.linalg.norm(matrix, axis=0)
    scaled = matrix / np.where(lengths > 0.0, lengths, 1.0)
    left = scaled[:, places]
    if rest:
        left = left - scaled[:, rest] @ np.linalg.lstsq(scaled[:, rest], left, rcond=1e-8)[0]
    whole = np.vstack([one.nuisance for one in lin.records])[:, places]
    shares = np.linalg.norm(left, axis=0) * lengths[places]
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
            fold = tuple(k for k, own in enumerate(key) if own == value)
            if len(fold) < len(records) and fold not in seen:
                seen.add(fold)
                yield fold


def _loss(
    lin: Linearisation,
    inside: Sequence[int],
    outside: Sequence[int],
    free: Sequence[int],
    off: tuple[Sequence[int], Floats] | None,
) -> float:
    """Squares on `outside` after the nuisances `free` were fitted on `inside`."""
    weight, prior = lin.prior
    matrix = np.vstack([*(lin.records[k].nuisance for k in inside), weight])
    right = np.concatenate([*(_residual(lin, k, off) for k in inside), prior])
    moved = matrix[:, free]
    lengths = np.linalg.norm(moved, axis=0)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    step = np.linalg.lstsq(moved / scale, right, rcond=1e-8)[0] / scale
    total = 0.0
    for k in outside:
        left = _residual(lin, k, off) - lin.records[k].nuisance[:, free] @ step
        total += float(left @ left)
    return total


def _residual(lin: Linearisation, k: int, off: tuple[Sequence[int], Floats] | None) -> Floats:
    record = lin.records[k]
    if off is None:
        return record.residual
    places, sizes = off
    return record.residual + record.nuisance[:, places] @ sizes
