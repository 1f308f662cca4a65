"""Simulated outputs as sensors with imperfect calibrations read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.trajectories import OfEachRecord, Trajectories
from rigctl.model.reading_errors import CalibrationError

Floats = NDArray[np.float64]


def as_read(
    simulated: Trajectories,
    runs: Sequence[str],
    errors: Sequence[CalibrationError],
    values: Sequence[Mapping[str, float]],
    columns: Sequence[str],
) -> Trajectories:
    """The outputs ``r = y + Σ_k c_k·b_k(y)``, and their derivatives.

    With respect to whatever moves y they are ``(1 + Σ_k c_k·b_k'(y))·∂y``, and ``b_k(y)`` with respect to
    c_k.

    Parameters
    ----------
    runs: of each record.
    errors: of the outputs' calibrations.
    values: of each record, the c_k by name.
    columns: requested derivatives; those among `errors` are added, after the simulated ones.
    """
    # r = y + Σ c_k·b_k(y), every b_k at the true y: the parts of an error do not act on each other. The
    # arrays of a record that no error changes are not copied
    added = [one for one in errors if one.name in columns]
    true, read = simulated.outputs, []
    for run, sizes, outputs in zip(runs, values, true, strict=True):
        array = outputs
        for one in errors:
            if sizes[one.name] and one.acts_in(run):
                array = array.copy() if array is outputs else array
                k = simulated.output_names.index(one.channel)
                array[:, k] += sizes[one.name] * one.basis(outputs[:, k])
        read.append(array)
    derivatives = _ReadDerivatives(simulated, runs, errors, values, added)
    return replace(
        simulated,
        outputs=tuple(read),
        sensitivities=derivatives if simulated.columns or added else simulated.sensitivities,
        columns=(*simulated.columns, *(one.name for one in added)),
    )


class _ReadDerivatives(OfEachRecord):
    """The derivatives of each record's readings; a fit that rejects its step uses none."""

    def __init__(
        self,
        simulated: Trajectories,
        runs: Sequence[str],
        errors: Sequence[CalibrationError],
        values: Sequence[Mapping[str, float]],
        added: Sequence[CalibrationError],
    ) -> None:
        self._simulated, self._runs, self._errors = simulated, runs, errors
        self._values, self._added = values, added
        self._known: dict[int, Floats] = {}

    def __len__(self) -> int:
        return len(self._runs)

    def of(self, record: int) -> Floats:
        """As the sensors read them."""
        if record not in self._known:
            self._known[record] = self._read(record)
        return self._known[record]

    def _read(self, index: int) -> Floats:
        # (n, outputs, columns): the chain rule for what moves y, then a column b_k(y) for each error that is
        # free
        true, run, sizes = self._simulated.outputs[index], self._runs[index], self._values[index]
        slopes = self._simulated.sensitivities[index]
        names = self._simulated.output_names
        factors = np.ones(true.shape)
        for one in self._errors:
            if sizes[one.name] and one.acts_in(run):
                k = names.index(one.channel)
                factors[:, k] += sizes[one.name] * one.slope(true[:, k])
        result = np.zeros((*true.shape, slopes.shape[2] + len(self._added)))
        np.multiply(slopes, factors[:, :, None], out=result[:, :, : slopes.shape[2]])
        for column, one in enumerate(self._added, slopes.shape[2]):
            if one.acts_in(run):
                k = names.index(one.channel)
                result[:, k, column] = one.basis(true[:, k])
        return result
