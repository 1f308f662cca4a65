"""Pairs of candidates on the linearised problem: two effects may lower the criterion only together."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rigctl.analysis.linear.nuisance_projection import Projected
from rigctl.analysis.linear.score_test import cone

#: columns of two effects with a larger cosine than this count as one direction
_SAME = 0.9999


@dataclass(frozen=True)
class PairGain:
    """Two candidates and the reduction of χ² that the linear problem predicts for both together."""

    candidates: tuple[int, int]
    gain: float


def pair_gains(projected: Projected) -> tuple[PairGain, ...]:
    """All compatible pairs, largest gain first; of the shapes of a pair only the best."""
    lin = projected.linearisation
    usable = projected.usable
    unit = np.where(usable, 1.0 / np.where(usable, projected.lengths, 1.0), 0.0)
    signatures = projected.signatures * unit
    cosines = signatures.T @ signatures
    # One matrix of cosines serves all pairs: the gain of a pair needs its own block of it and its scores, and
    # no further projection.
    z = signatures.T @ projected.residual
    columns = {
        index: np.flatnonzero(usable[lin.columns_of(index)]) + lin.starts[index]
        for index in range(len(lin.candidates))
    }
    gains = []
    for one, other in combinations(
        [index for index, usable_columns in columns.items() if usable_columns.size], 2
    ):
        if lin.candidates[one].name == lin.candidates[other].name or _contradict(projected, one, other):
            continue
        both = np.concatenate([columns[one], columns[other]])
        square = cosines[np.ix_(both, both)]
        if np.abs(square - np.eye(both.size)).max() > _SAME:
            continue
        signs = [_sign(projected, index, int(c)) for index in (one, other) for c in columns[index]]
        gain, _ = cone(z[both][None, :], square, signs)
        gains.append(PairGain((one, other), float(gain[0])))
    best: dict[frozenset[str], PairGain] = {}
    for pair in sorted(gains, key=lambda pair: -pair.gain):
        best.setdefault(frozenset(lin.candidates[index].name for index in pair.candidates), pair)
    return tuple(best.values())


def _contradict(projected: Projected, one: int, other: int) -> bool:
    first, second = (projected.linearisation.candidates[index].effect for index in (one, other))
    return second.name in first.instead_of or first.name in second.instead_of


def _sign(projected: Projected, index: int, column: int) -> int:
    lin = projected.linearisation
    return lin.candidates[index].signs[column - lin.starts[index]]
