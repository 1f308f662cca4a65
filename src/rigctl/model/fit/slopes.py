"""Derivatives of records of which one integration has spoilt some.

The derivatives are those of the steps taken. Where a fast oscillation is passed over by steps as long
as the tolerance allows, the outputs are right and the steps' own derivatives may grow from one step to the
next: too large by orders of magnitude in one record of many, and a fit then moves nothing any more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.compile import CompiledSystem
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.splines import NO_SPLINES, SplineColumns
from rigctl.engine.tolerance import TIGHT
from rigctl.engine.trajectories import Trajectories

Floats = NDArray[np.float64]

#: times the median over the records; the conditions of a campaign make some ten
_SPOILT = 100.0
#: columns that are spoilt together: one alone may belong to an effect that acts in few records
_TOGETHER = 2
#: records from which on one can be told from the others
_FEWEST = 4


def simulate_soundly(
    compiled: CompiledSystem,
    excitations: Sequence[Excitation],
    columns: Sequence[str],
    initial_columns: Sequence[str],
    shift_columns: Sequence[str] = (),
    splines: SplineColumns = NO_SPLINES,
) -> Trajectories:
    """As `simulate`; records whose derivatives are spoilt have those of a tight integration.

    That is made when one of them is first asked for: a fit that takes its step back asks for none.
    """
    how: dict[str, Any] = {
        "columns": columns,
        "initial_columns": initial_columns,
        "shift_columns": shift_columns,
        "splines": splines,
    }
    simulated = simulate(compiled, excitations, **how)
    spoilt = spoilt_records(simulated) if simulated.ok and simulated.columns else []
    if not spoilt:
        return simulated

    def again() -> Trajectories:
        return simulate(compiled, [excitations[index] for index in spoilt], tolerance=TIGHT, **how)

    return replace(simulated, sensitivities=_Mended(simulated.sensitivities, spoilt, again))


class _Mended(Sequence[Floats]):
    """Derivatives of all records, of which those at `spoilt` are worked out when one is first asked for."""

    def __init__(
        self, slopes: Sequence[Floats], spoilt: Sequence[int], again: Callable[[], Trajectories]
    ) -> None:
        self._slopes, self._spoilt, self._again = list(slopes), frozenset(spoilt), again
        self._order = tuple(spoilt)

    def __len__(self) -> int:
        return len(self._slopes)

    @overload
    def __getitem__(self, index: int) -> Floats: ...
    @overload
    def __getitem__(self, index: slice) -> list[Floats]: ...
    def __getitem__(self, index: int | slice) -> Floats | list[Floats]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        if self._spoilt and range(len(self))[index] in self._spoilt:
            self._mend()
        return self._slopes[index]

    def _mend(self) -> None:
        found = self._again()
        for index, slopes, failure in zip(self._order, found.sensitivities, found.failures, strict=True):
            if failure is None:
                self._slopes[index] = slopes
        self._spoilt = frozenset()


def spoilt_records(simulated: Trajectories) -> list[int]:
    """The places of records whose derivatives are far beyond the others', in several columns at once."""
    if len(simulated.sensitivities) < _FEWEST:
        return []
    sizes = np.array([_sizes(slopes) for slopes in simulated.sensitivities])
    median = np.median(sizes, axis=0)
    beyond = np.any((sizes > _SPOILT * median) & (median > 0.0), axis=1)
    wanted = min(_TOGETHER, sizes.shape[2])
    return [int(index) for index in np.flatnonzero(np.count_nonzero(beyond, axis=1) >= wanted)]


def _sizes(slopes: Floats) -> Floats:
    """(outputs, columns) the largest of a record; what is not a number is beyond everything."""
    largest = np.abs(slopes).max(axis=0, initial=0.0)
    return np.where(np.isfinite(largest), largest, np.inf)
