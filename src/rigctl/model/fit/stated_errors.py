"""How fitted numbers follow the errors of sensors of which only an uncertainty is stated.

Such sensors are exact in fits and searches (`rigctl.analysis.agreement.sensors` says why), but what they
read is not, and the numbers fitted to it are off with them. A fit that ended at θ would have ended at
``θ + S·c`` if errors c had been known; with their stated variances P, the covariance of θ is

    C + S·P·Sᵀ,      S = -C·JᵀK,

C being that of the fit, J and K the derivatives of the whitened residuals by unknowns and errors. Neither the
fit nor a verdict changes: where the data contradict exact sensors, the comparison is repeated with these
errors as unknowns.
Source: JCGM 100:2008 (GUM), 5.1.2, the law of propagation of uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.least_squares import Refused, slopes_of_minimum
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.record import MeasuredRecord
from rigctl.model.reading_errors import CalibrationError, ReadingError

Floats = NDArray[np.float64]

#: steps of the differences by an input's error that are tried in turn, in its standard deviations: a model
#: may have no value for an input that is negative
_STEPS = (1.0, 0.1, 0.01)


@dataclass(frozen=True)
class StatedErrors:
    """Errors of sensors that a fit took for exact, and what they do to its numbers.

    Attributes
    ----------
    errors: each part of a calibration, with the standard deviation that is stated of it.
    shifts: (unknowns, errors) of the shared unknowns, by one standard deviation of each, SI.
    """

    errors: tuple[ReadingError, ...]
    shifts: Floats

    @property
    def covariance(self) -> Floats:
        """(unknowns, unknowns) ``S·P·Sᵀ``."""
        return np.asarray(self.shifts @ self.shifts.T)


def stated_errors(problem: Problem, shared: Floats, local: Sequence[Floats]) -> StatedErrors:
    """What the stated errors of exact sensors do to a fit; an infinite shift if it cannot be computed.

    Parameters
    ----------
    problem: with the fitted records alone.
    shared, local: where the fit ended.
    """
    errors = problem.measurements.possible_errors
    none = StatedErrors((), np.zeros((shared.size, 0)))
    if not errors or not shared.size:
        return none
    blocks = problem.evaluate(shared, local, derivatives=True)
    if isinstance(blocks, Refused):
        return none
    # S: how the minimum moves with each error, the records' own unknowns following
    columns, lost = _columns(problem, errors, shared, local)
    slopes = slopes_of_minimum(blocks, columns, problem.shared, problem.local_unknowns(), shared, local)
    shifts = slopes * np.array([one.std for one in errors])
    # what cannot be computed is not zero: no number is then said to be known better than it is
    shifts[:, lost] = np.inf
    return StatedErrors(errors, shifts)


def _columns(
    problem: Problem, errors: Sequence[ReadingError], shared: Floats, local: Sequence[Floats]
) -> tuple[list[Floats], list[int]]:
    """(values, errors) the derivatives K of each record, whitened; and those that cannot be computed."""
    outputs = problem.outputs_at(shared, local)
    columns, lost = [np.zeros((*each.shape, len(errors))) for each in outputs], []
    for k, error in enumerate(errors):
        if not isinstance(error, CalibrationError):
            continue
        # an output's error is added to what was read: K is its basis at the model's value. One of an input
        # goes through the equations, which have no parameter for it as long as it counts as exact: a
        # difference
        if error.channel in problem.measurements.outputs:
            channel = problem.measurements.outputs.index(error.channel)
            for record, each, column in zip(problem.records, outputs, columns, strict=True):
                if error.acts_in(record.run):
                    column[:, channel, k] = error.basis(each[:, channel])
        else:
            moved = _by_input(problem, error, shared, local)
            lost += [k] if moved is None else []
            for column, each in zip(columns, moved or (), strict=moved is not None):
                column[:, :, k] = each
    return [whitener(column) for whitener, column in zip(problem.whiteners, columns, strict=True)], lost


def _by_input(
    problem: Problem, error: CalibrationError, shared: Floats, local: Sequence[Floats]
) -> list[Floats] | None:
    """(n, outputs) of each record, the derivative by the error of a measured input; None if the model has no
    value beside these inputs, however small the step."""
    steps = (share * error.std for share in _STEPS)
    tried = (_difference(problem, error, shared, local, step) for step in steps)
    return next((found for found in tried if found is not None), None)


def _difference(
    problem: Problem, error: CalibrationError, shared: Floats, local: Sequence[Floats], step: float
) -> list[Floats] | None:
    """The central difference over a step of the error to both sides."""
    index = problem.measurements.inputs.index(error.channel)
    ends = []
    for size in (step, -step):
        records = tuple(_read_wrong(record, index, error, size) for record in problem.records)
        moved = replace(problem, measurements=replace(problem.measurements, records=records))
        simulated = moved.simulate(shared, local)
        if not simulated.ok:
            return None
        ends.append([np.take(each, problem.channels, axis=1) for each in simulated.outputs])
    return [(high - low) / (2.0 * step) for high, low in zip(*ends, strict=True)]


def _read_wrong(record: MeasuredRecord, index: int, error: CalibrationError, size: float) -> MeasuredRecord:
    """The record as it would have been without this error of its input."""
    if not error.acts_in(record.run) or error.channel in record.unrecorded:
        return record
    if index in record.along:
        lines, column = record.lines.copy(), record.along.index(index)
        lines[:, column] -= size * error.basis(lines[:, column])
        return replace(record, lines=lines)
    inputs = record.inputs.copy()
    inputs[:, index] -= size * error.basis(inputs[:, index])
    return replace(record, inputs=inputs)
