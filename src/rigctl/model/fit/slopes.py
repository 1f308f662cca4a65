"""Derivatives of records of which one integration has spoilt some.

The derivatives are those of the steps taken. Where a fast oscillation is passed over by steps as long
as the tolerance allows, the outputs are right and the steps' own derivatives may grow from one step to the
next: too large by orders of magnitude in one record of many, and a fit then moves nothing any more.

An oscillation that the steps do follow makes derivatives that are as large and right: what shifts its phase
moves every sample. The two are told apart by somewhat finer steps, which leave right ones nearly as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.compile import CompiledSystem
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.splines import NO_SPLINES, SplineColumns
from rigctl.engine.tolerance import DEFAULT, TIGHT, Tolerance
from rigctl.engine.trajectories import Trajectories

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: times the median over the records; the conditions of a campaign make some ten
_BEYOND = 100.0
#: columns that are beyond together: one alone may belong to an effect that acts in few records
_TOGETHER = 2
#: records from which on one can be told from the others
_FEWEST = 4
#: finer steps, half as many again, under which right derivatives stay as they are
_FINER = Tolerance(relative=0.3 * DEFAULT.relative, absolute=0.3 * DEFAULT.absolute)
#: share of its length by which such a column may change: right ones have changed by 0.3 at most, spoilt ones
#: by 4 at least
_STAYS = 0.7


def simulate_soundly(
    compiled: CompiledSystem,
    excitations: Sequence[Excitation],
    columns: Sequence[str],
    initial_columns: Sequence[str],
    shift_columns: Sequence[str] = (),
    splines: SplineColumns = NO_SPLINES,
) -> Trajectories:
    """As `simulate`; records whose derivatives are spoilt have those of a tight integration.

    Those that only look it have the derivatives of the finer steps that told so. Either is made when one of
    them is first asked for: a fit that takes its step back asks for none.
    """
    how: dict[str, Any] = {
        "columns": columns,
        "initial_columns": initial_columns,
        "shift_columns": shift_columns,
        "splines": splines,
    }
    simulated = simulate(compiled, excitations, **how)
    suspects = beyond_the_others(simulated) if simulated.ok and simulated.columns else {}
    if not suspects:
        return simulated

    def again(indices: Sequence[int], tolerance: Tolerance) -> Trajectories:
        return simulate(compiled, [excitations[index] for index in indices], tolerance=tolerance, **how)

    return replace(simulated, sensitivities=_Mended(simulated.sensitivities, suspects, again))


class _Mended(Sequence[Floats]):
    """Derivatives of all records; those of the `suspects` are looked into when one is first asked for."""

    def __init__(
        self,
        slopes: Sequence[Floats],
        suspects: Mapping[int, Flags],
        again: Callable[[Sequence[int], Tolerance], Trajectories],
    ) -> None:
        self._slopes, self._suspects, self._again = list(slopes), dict(suspects), again

    def __len__(self) -> int:
        return len(self._slopes)

    @overload
    def __getitem__(self, index: int) -> Floats: ...
    @overload
    def __getitem__(self, index: slice) -> list[Floats]: ...
    def __getitem__(self, index: int | slice) -> Floats | list[Floats]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        if range(len(self))[index] in self._suspects:
            self._mend()
        return self._slopes[index]

    def _mend(self) -> None:
        spoilt = []
        for index, finer in self._integrated(list(self._suspects), _FINER):
            beyond = self._suspects[index]
            if finer is not None and _stay(self._slopes[index][:, beyond], finer[:, beyond]):
                self._slopes[index] = finer
            else:
                spoilt.append(index)
        for index, right in self._integrated(spoilt, TIGHT):
            if right is not None:
                self._slopes[index] = right
        self._suspects = {}

    def _integrated(self, indices: Sequence[int], tolerance: Tolerance) -> list[tuple[int, Floats | None]]:
        """Each with its derivatives; None where it could not be integrated."""
        if not indices:
            return []
        found = self._again(indices, tolerance)
        return [
            (index, slopes if failure is None else None)
            for index, slopes, failure in zip(indices, found.sensitivities, found.failures, strict=True)
        ]


def _stay(coarse: Floats, finer: Floats) -> bool:
    """Whether (samples, columns) are nearly what they are with finer steps."""
    if not (np.isfinite(coarse).all() and np.isfinite(finer).all()):
        return False
    changes, lengths = (np.linalg.norm(one, axis=0) for one in (finer - coarse, finer))
    shorter = np.minimum(lengths, np.linalg.norm(coarse, axis=0))
    return bool(np.all(changes <= _STAYS * shorter))


def beyond_the_others(simulated: Trajectories) -> dict[int, Flags]:
    """The places of records whose derivatives are far beyond the others' in several columns at once, and
    (outputs, columns) of which."""
    if len(simulated.sensitivities) < _FEWEST:
        return {}
    sizes = np.array([_sizes(slopes) for slopes in simulated.sensitivities])
    median = np.median(sizes, axis=0)
    beyond = (sizes > _BEYOND * median) & (median > 0.0)
    wanted = min(_TOGETHER, sizes.shape[2])
    found = np.flatnonzero(np.count_nonzero(beyond.any(axis=1), axis=1) >= wanted)
    return {int(index): beyond[index] for index in found}


def _sizes(slopes: Floats) -> Floats:
    """(outputs, columns) the largest of a record; what is not a number is beyond everything."""
    largest = np.abs(slopes).max(axis=0, initial=0.0)
    return np.where(np.isfinite(largest), largest, np.inf)
