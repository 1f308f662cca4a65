"""A table beside a model: every value that was read, and the model's prediction of it.

In: a fit of a table. Out: a `TableRow` for each value, with its error in units of the noise, and that of the
file's own values where they were fitted. Every other finding on a table is about these rows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.conditions import variable_units
from rigctl.units import parse_unit, show

Floats = NDArray[np.float64]

#: if the model's file misses a value by more standard deviations than this, its parameters were mere starting
#: values
_START = 12.0


@dataclass(frozen=True)
class TableRow:
    """One value of a table; numbers in the unit of the file.

    Attributes
    ----------
    record: its index; fitted: whether the fit saw it.
    condition: where it was read, e.g. ``60 degC, 30 bar``.
    quantity: the file's column.
    measured, predicted: by the table and by the model; `noise` the standard deviation of the reading.
    unfitted: the prediction with the parameters of the model's file; None if it was not fitted.
    beside: other columns of the file for the same quantity, e.g. values from another law.
    """

    record: int
    fitted: bool
    condition: str
    quantity: str
    unit: str
    measured: float
    predicted: float
    noise: float
    unfitted: float | None
    beside: Mapping[str, float]

    @property
    def z(self) -> float:
        """Model less measurement in standard deviations of the reading."""
        return (self.predicted - self.measured) / self.noise

    @property
    def z_unfitted(self) -> float | None:
        """As `z`, with the parameters of the model file instead of the fitted ones."""
        return None if self.unfitted is None else (self.unfitted - self.measured) / self.noise

    def share(self, value: float) -> float:
        """Relative deviation of a value from the measured one; NaN if that is 0."""
        return (value - self.measured) / self.measured if self.measured else math.nan

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "condition": self.condition,
            "quantity": self.quantity,
            "unit": self.unit,
            "measured": self.measured,
            "model": self.predicted,
            "noise": self.noise,
            "z": self.z,
            "unfitted": self.unfitted,
            "beside": dict(self.beside),
            "held_out": not self.fitted,
        }


def table_rows(fit: FitResult) -> tuple[TableRow, ...]:
    """Every value of a table, quantity by quantity, in the file's order; none if there is no table."""
    measurements = fit.problem.measurements
    if not measurements.table:
        return ()
    units = variable_units(measurements)
    unfitted = unfitted_outputs(fit)
    rows = []
    for column, (output, unit_name) in enumerate(zip(measurements.outputs, measurements.units, strict=True)):
        unit, title = parse_unit(unit_name), measurements.titles.get(output, output)
        for index, record in enumerate(fit.problem.records):
            at = np.flatnonzero(fit.problem.ok[index][:, column])
            if not at.size:
                continue
            moment = int(at[-1])
            before = None if unfitted is None else float(unfitted[index][moment, column])
            rows.append(
                TableRow(
                    record=index,
                    fitted=index in fit.fitted,
                    condition=short_condition(record.condition, units) or f"record {record.index}",
                    quantity=title,
                    unit=unit_name,
                    measured=unit.from_si(float(record.values[moment, column])),
                    predicted=unit.from_si(float(fit.expected_outputs[index][moment, column])),
                    noise=float(fit.problem.sigma[index][moment, column]) / unit.factor,
                    unfitted=None if before is None else unit.from_si(before),
                    beside={
                        name: unit.from_si(value)
                        for name, value in record.beside.items()
                        if name.startswith(f"{title}_") and measurements.columns.get(name) == unit_name
                    },
                )
            )
    return tuple(_of_one_kind(rows))


def _of_one_kind(rows: Sequence[TableRow]) -> list[TableRow]:
    """Keep only columns whose values are of similar magnitude in every row: another law's values, not
    differences."""
    names = dict.fromkeys(name for row in rows for name in row.beside)
    kept = {
        name
        for name in names
        if all(
            0.5 < row.beside[name] / row.measured < 2.0 if row.measured else False
            for row in rows
            if math.isfinite(row.beside.get(name, math.nan))
        )
    }
    return [
        replace(row, beside={name: value for name, value in row.beside.items() if name in kept})
        for row in rows
    ]


def shows_unfitted(rows: Sequence[TableRow]) -> bool:
    """Whether the parameters of the model's file are worth showing: they were no mere starting values."""
    scores = [abs(row.z_unfitted) if row.z_unfitted is not None else math.inf for row in rows]
    return max(scores, default=math.inf) < _START


def unfitted_outputs(fit: FitResult) -> tuple[Floats, ...] | None:
    """(n, outputs) of each record with the parameters of the model's file; None without a fit."""
    problem = fit.problem
    if fit.solution is None:
        return None
    known = problem.model.values
    shared = np.array([known.get(unknown.name, unknown.start) for unknown in problem.shared])
    levels = np.array([unknown.name in problem.level.setting_names for unknown in problem.shared], dtype=bool)
    record_local = [np.array([unknown.start for unknown in one]) for one in problem.local_unknowns()]
    simulated = problem.simulate(np.where(levels, 0.0, shared), record_local)
    if not simulated.ok:
        return None
    return tuple(np.take(array, problem.channels, axis=1) for array in simulated.outputs)


def short_condition(condition: Mapping[str, float], units: Mapping[str, str]) -> str:
    """An operating point by its values alone: ``60 degC, 30 bar``."""
    return ", ".join(show(value, units[name]) for name, value in condition.items() if name in units)
