"""The regions of the residuals: each combination of phase and channel, over all records."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]

_MOST_PHASES = 24
_MOST_VARIABLES = 3


@dataclass(frozen=True)
class Regions:
    """The combinations of phase and channel, over all records.

    Attributes
    ----------
    labels: (phase, channel) of each column.
    conditions: (records, variables) the records' operating points, each variable scaled to −1 … 1.
    variables: names of these variables.
    groups: (records) index of each record's condition.
    """

    labels: tuple[tuple[str, str], ...]
    conditions: Floats
    variables: tuple[str, ...]
    groups: tuple[int, ...]
    _phase: tuple[NDArray[np.intp], ...] = field(repr=False)
    _channels: int = 0

    def of_record(self, k: int, rows: NDArray[np.intp]) -> Floats:
        """(rows, columns) the unit vector of each region: ``EᵀW e`` is the sum of its residuals over √n."""
        region = self._phase[k][rows[:, 0]] * self._channels + rows[:, 1]
        columns = (region[:, None] == np.arange(len(self.labels))[None, :]).astype(float)
        lengths = np.sqrt(columns.sum(axis=0))
        return np.asarray(columns / np.where(lengths > 0.0, lengths, 1.0))

    def plane(self, k: int) -> Floats:
        """(basis) 1, each variable, and the products of two, at a record's condition."""
        point = self.conditions[k]
        products = [point[i] * point[j] for i in range(point.size) for j in range(i + 1, point.size)]
        return np.array([1.0, *point, *products])


def make_regions(problem: Problem) -> Regions:
    """The regions of a problem's records."""
    records, outputs = problem.records, problem.measurements.outputs
    phases = tuple(dict.fromkeys(name for record in records for name in record.phases))
    if len(phases) > _MOST_PHASES:  # a table, each row of which is a phase
        phases = ("all",)
    index = {name: k for k, name in enumerate(phases)}
    phase_of = tuple(
        np.array([index.get(name, 0) for name in record.phases], dtype=np.intp)[record.phase]
        for record in records
    )
    names, points = _conditions(problem)
    return Regions(
        labels=tuple((phase, channel) for phase in phases for channel in outputs),
        conditions=points,
        variables=names,
        groups=tuple(record.group for record in records),
        _phase=phase_of,
        _channels=len(outputs),
    )


def _conditions(problem: Problem) -> tuple[tuple[str, ...], Floats]:
    records = problem.records
    names = [
        name for name in problem.measurements.variables if all(name in record.condition for record in records)
    ][:_MOST_VARIABLES]
    values = np.array([[record.condition[name] for name in names] for record in records])
    values = values.reshape(len(records), len(names))
    if not len(names):
        return (), values
    low, high = values.min(axis=0), values.max(axis=0)
    half = np.where(high > low, 0.5 * (high - low), 1.0)
    return tuple(names), (values - 0.5 * (high + low)) / half
