"""Derivatives of records of which one integration has spoilt some.

The derivatives are those of the steps taken. Where a fast oscillation is passed over by steps as long
as the tolerance allows, the outputs are right and the steps' own derivatives may grow from one step to the
next: too large by orders of magnitude in one record of many, and a fit then moves nothing any more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.compile import CompiledSystem
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.splines import NO_SPLINES, SplineColumns
from rigctl.engine.tolerance import TIGHT
from rigctl.engine.trajectories import Trajectories

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
    """As `simulate`; records whose derivatives are spoilt have those of a tight integration."""
    simulated = simulate(
        compiled,
        excitations,
        columns=columns,
        initial_columns=initial_columns,
        shift_columns=shift_columns,
        splines=splines,
    )
    spoilt = spoilt_records(simulated) if simulated.ok and simulated.columns else []
    if not spoilt:
        return simulated
    again = simulate(
        compiled,
        [excitations[index] for index in spoilt],
        columns=columns,
        initial_columns=initial_columns,
        shift_columns=shift_columns,
        splines=splines,
        tolerance=TIGHT,
    )
    slopes = list(simulated.sensitivities)
    for index, sensitivities, failure in zip(spoilt, again.sensitivities, again.failures, strict=True):
        if failure is None:
            slopes[index] = sensitivities
    return replace(simulated, sensitivities=tuple(slopes))


def spoilt_records(simulated: Trajectories) -> list[int]:
    """The places of records whose derivatives are far beyond the others', in several columns at once."""
    if len(simulated.sensitivities) < _FEWEST:
        return []
    sizes = np.array([_sizes(slopes) for slopes in simulated.sensitivities])
    median = np.median(sizes, axis=0)
    beyond = np.any((sizes > _SPOILT * median) & (median > 0.0), axis=1)
    wanted = min(_TOGETHER, sizes.shape[2])
    return [int(index) for index in np.flatnonzero(np.count_nonzero(beyond, axis=1) >= wanted)]


def _sizes(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(outputs, columns) the largest of a record; what is not a number is beyond everything."""
    largest = np.abs(slopes).max(axis=0, initial=0.0)
    return np.where(np.isfinite(largest), largest, np.inf)
