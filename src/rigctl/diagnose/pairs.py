"""An exhaustive look at pairs of effects on the linearised problem: two may only pay together."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rigctl.compare.projected import Projected
from rigctl.compare.scores import cone

Floats = NDArray[np.float64]

#: columns of the two that are as alike as this are one direction
_SAME = 0.9999


@dataclass(frozen=True)
class PairGain:
    """Two candidates and the fall of χ² that the linear problem expects of them together."""

    places: tuple[int, int]
    gain: float
    parameters: int
    sizes: dict[str, float]


def pair_gains(projected: Projected) -> tuple[PairGain, ...]:
    """All pairs that can stand together, the largest gain first; of a pair's shapes the best one."""
    lin = projected.linearisation
    usable = projected.usable
    unit = np.where(usable, 1.0 / np.where(usable, projected.lengths, 1.0), 0.0)
    signatures = projected.signatures * unit
    cosines = signatures.T @ signatures
    z = signatures.T @ projected.residual
    columns = {
        place: np.flatnonzero(usable[lin.columns_of(place)]) + lin.starts[place]
        for place in range(len(lin.candidates))
    }
    found = []
    for one, other in combinations([place for place, own in columns.items() if own.size], 2):
        if lin.candidates[one].name == lin.candidates[other].name or _contradict(projected, one, other):
            continue
        both = np.concatenate([columns[one], columns[other]])
        square = cosines[np.ix_(both, both)]
        if np.abs(square - np.eye(both.size)).max() > _SAME:
            continue
        signs = [_sign(projected, place, int(c)) for place in (one, other) for c in columns[place]]
        gain, sizes = cone(z[both][None, :], square, signs)
        used = int(np.count_nonzero(sizes[0]))
        named = {
            _name(projected, int(c)): float(size * unit[c]) for c, size in zip(both, sizes[0], strict=True)
        }
        found.append(PairGain((one, other), float(gain[0]), used, named))
    best: dict[frozenset[str], PairGain] = {}
    for pair in sorted(found, key=lambda pair: -pair.gain):
        best.setdefault(frozenset(lin.candidates[place].name for place in pair.places), pair)
    return tuple(best.values())


def _contradict(projected: Projected, one: int, other: int) -> bool:
    first, second = (projected.linearisation.candidates[place].effect for place in (one, other))
    return second.name in first.instead_of or first.name in second.instead_of


def _sign(projected: Projected, place: int, column: int) -> int:
    lin = projected.linearisation
    return lin.candidates[place].signs[column - lin.starts[place]]


def _name(projected: Projected, column: int) -> str:
    lin = projected.linearisation
    place = max(k for k, start in enumerate(lin.starts) if start <= column)
    return lin.candidates[place].columns[column - lin.starts[place]]
