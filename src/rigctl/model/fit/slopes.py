"""Replace inaccurate derivatives of some records.

Derivatives are those of the integration steps taken. If a fast oscillation is skipped by steps as long as the
tolerance allows, the outputs are right, but the steps' own derivatives may grow from one step to the next:
too large by orders of magnitude in one record of many, and a fit then stalls.

An oscillation that the steps do resolve has derivatives that are as large and right, because a phase shift
moves every sample. The two cases are distinguished by somewhat finer steps, which hardly change correct
derivatives.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.compile import CompiledSystem
from rigctl.engine.excitation import Excitation
from rigctl.engine.simulate import simulate
from rigctl.engine.splines import NO_SPLINES, SplineColumns
from rigctl.engine.tolerance import DEFAULT, TIGHT, Tolerance
from rigctl.engine.trajectories import OfEachRecord, Trajectories

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: ratio to the median over the records; the conditions of a campaign cause ratios of up to ten or so
_BEYOND = 100.0
#: least number of such columns: a single one may belong to an effect that acts in few records
_TOGETHER = 2
#: least number of records for a comparison
_FEWEST = 4
#: tolerance of finer steps, half as many again, under which correct derivatives stay unchanged
_FINER = Tolerance(relative=0.3 * DEFAULT.relative, absolute=0.3 * DEFAULT.absolute)
#: largest relative change of a column that counts as correct: its error is proportional to the tolerance, so
#: that the column of the finer steps is then off by less than a quarter
_STAYS = 0.5


def simulate_soundly(
    compiled: CompiledSystem,
    excitations: Sequence[Excitation],
    columns: Sequence[str],
    initial_columns: Sequence[str],
    shift_columns: Sequence[str] = (),
    splines: SplineColumns = NO_SPLINES,
) -> Trajectories:
    """As `simulate`; records with inaccurate derivatives get those of an integration with tight tolerance.

    Suspects that prove correct get the derivatives of the finer steps used for the test. Either is computed
    only when a derivative is first used: a fit that rejects its step uses none.
    """
    how: dict[str, Any] = {
        "columns": columns,
        "initial_columns": initial_columns,
        "shift_columns": shift_columns,
        "splines": splines,
    }
    # the outputs of this integration stay; only derivatives of suspects are replaced, and only once one is
    # used
    simulated = simulate(compiled, excitations, **how)
    # of a program's records the derivatives are checked differences, and not yet made
    if compiled.cascade is not None:
        return simulated
    suspects = beyond_the_others(simulated) if simulated.ok and simulated.columns else {}
    if not suspects:
        return simulated

    def again(indices: Sequence[int], tolerance: Tolerance) -> Trajectories:
        return simulate(compiled, [excitations[index] for index in indices], tolerance=tolerance, **how)

    return replace(simulated, sensitivities=_CheckedDerivatives(simulated.sensitivities, suspects, again))


class _CheckedDerivatives(OfEachRecord):
    """Derivatives of all records; those of the `suspects` are tested when one is first used."""

    def __init__(
        self,
        slopes: Sequence[Floats],
        suspects: Mapping[int, Flags],
        again: Callable[[Sequence[int], Tolerance], Trajectories],
    ) -> None:
        self._slopes, self._suspects, self._again = list(slopes), dict(suspects), again
        self._mending = threading.Lock()  # records are read in several threads

    def __len__(self) -> int:
        return len(self._slopes)

    def of(self, record: int) -> Floats:
        """As computed, or mended if it is a suspect."""
        if record in self._suspects:
            with self._mending:
                self._mend()
        return self._slopes[record]

    def _mend(self) -> None:
        # somewhat finer steps decide: right derivatives hardly change, and are then taken from these steps,
        # whose error is smaller; what changes is spoilt, and only for that the tight tolerance is paid
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
        """Each with its derivatives; None if it could not be integrated."""
        if not indices:
            return []
        simulated = self._again(indices, tolerance)
        return [
            (index, slopes if failure is None else None)
            for index, slopes, failure in zip(
                indices, simulated.sensitivities, simulated.failures, strict=True
            )
        ]


def _stay(coarse: Floats, finer: Floats) -> bool:
    """Whether (samples, columns) are nearly the same with finer steps."""
    if not (np.isfinite(coarse).all() and np.isfinite(finer).all()):
        return False
    # relative to the shorter of the two, right derivatives change by 0.3 at most, spoilt ones by 4 and more
    # (decision 24)
    changes, lengths = (np.linalg.norm(one, axis=0) for one in (finer - coarse, finer))
    shorter = np.minimum(lengths, np.linalg.norm(coarse, axis=0))
    return bool(np.all(changes <= _STAYS * shorter))


def beyond_the_others(simulated: Trajectories) -> dict[int, Flags]:
    """The indices of records whose derivatives far exceed the others' in several columns at once, with
    (outputs, columns) flags."""
    if len(simulated.sensitivities) < _FEWEST:
        return {}
    # (records, outputs, columns); the records are those of one campaign, so that their derivatives are of one
    # order of magnitude unless something is wrong with them
    sizes = np.array([_sizes(slopes) for slopes in simulated.sensitivities])
    median = np.median(sizes, axis=0)
    beyond = (sizes > _BEYOND * median) & (median > 0.0)
    wanted = min(_TOGETHER, sizes.shape[2])
    indices = np.flatnonzero(np.count_nonzero(beyond.any(axis=1), axis=1) >= wanted)
    return {int(index): beyond[index] for index in indices}


def _sizes(slopes: Floats) -> Floats:
    """(outputs, columns) the largest magnitude in a record; infinite for values that are not numbers."""
    largest = np.abs(slopes).max(axis=0, initial=0.0)
    return np.where(np.isfinite(largest), largest, np.inf)
