"""Residual analysis: do a model's errors follow their own past, or that of an input?

Errors that are correlated with past inputs are model error, whatever the colour of the noise. Errors that are
correlated with their own past alone are slow noise or model error: no test on them can tell which.

Source: L. Ljung, *System Identification: Theory for the User*, 2nd ed. (1999), §16.6; G. E. P. Box, G. M.
Jenkins, *Time Series Analysis* (1976), §11.2 (prewhitening).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.decision_levels import INTERVAL
from rigctl.model.fit.fit import FitResult
from rigctl.noise import autocovariance, even_pieces, floor_of_residuals, portmanteau

Floats = NDArray[np.float64]

#: lags of both correlations
LAGS = 40
#: order of the autoregression that prewhitens errors and inputs
_ORDER = 8
#: order of the difference by which the white part of the errors is measured
_DIFFERENCE = 2
#: least correlation of errors with a past input that counts
_LEAST = 0.3
#: an input that changes less than this share of its magnitude is constant
_CONSTANT = 1e-9


@dataclass(frozen=True)
class Correlations:
    """Of the errors of one channel.

    Attributes
    ----------
    channel: its name.
    auto: (LAGS + 1) autocorrelation of the errors at lag 0, 1, …
    inputs: by input, (LAGS + 1) its correlation with the errors k samples later, both prewhitened.
    band: half-width of the 95 % band of no correlation.
    white_p: p-value of white errors (portmanteau test).
    inputs_p: by input, p-value of no correlation with its past: of the largest of all lags (Bonferroni).
    rms: SI, root mean square of the errors.
    white_rms: SI, root mean square of their white part, from differences; NaN if not determined.
    white_degrees: degrees of freedom of that.
    """

    channel: str
    auto: Floats = field(repr=False)
    inputs: dict[str, Floats] = field(repr=False)
    band: float
    white_p: float
    inputs_p: dict[str, float]
    rms: float
    white_rms: float
    white_degrees: int

    @property
    def follows(self) -> float:
        """p-value of the hypothesis that the errors follow the past of no input."""
        return min([1.0, *(len(self.inputs_p) * p for p in self.inputs_p.values())])

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "white_p_value": self.white_p,
            "input_p_values": dict(self.inputs_p),
            "autocorrelation": [round(value, 4) for value in self.auto.tolist()],
            "cross_correlation": {
                name: [round(value, 4) for value in values.tolist()] for name, values in self.inputs.items()
            },
            "band": self.band,
        }


def residual_correlations(fit: FitResult) -> dict[str, Correlations]:
    """By channel, over the fitted records; without channels of fewer than some ten evenly sampled errors."""
    problem = fit.problem
    result = {}
    for column, name in enumerate(problem.measurements.outputs):
        errors, courses = _series(fit, column)
        if sum(piece.size for piece in errors) <= 2 * _ORDER:
            continue
        result[name] = _correlations(name, errors, courses)
    return result


def _series(fit: FitResult, column: int) -> tuple[list[Floats], dict[str, list[Floats]]]:
    """Evenly sampled pieces of one channel's errors, and of every input over the same samples."""
    problem = fit.problem
    errors: list[Floats] = []
    courses: dict[str, list[Floats]] = {name: [] for name in problem.measurements.inputs}
    for k in fit.fitted:
        record = problem.records[k]
        error = np.where(
            problem.ok[k][:, column], fit.likely_outputs[k][:, column] - record.values[:, column], np.nan
        )
        pieces = list(even_pieces(record.times, error, problem.noise.spacing))
        errors += pieces
        for index, name in enumerate(problem.measurements.inputs):
            course = np.where(np.isfinite(error), record.input_course(index), np.nan)
            courses[name] += list(even_pieces(record.times, course, problem.noise.spacing))
    moving = {
        name: each
        for name, each in courses.items()
        if each and np.ptp(np.concatenate(each)) > _CONSTANT * np.max(np.abs(np.concatenate(each)))
    }
    return errors, moving


def _correlations(name: str, errors: list[Floats], courses: dict[str, list[Floats]]) -> Correlations:
    count = sum(piece.size for piece in errors)
    lags = min(LAGS, count // 4)
    sums = autocovariance(errors, lags)
    auto = sums / sums[0] if sums[0] > 0.0 else np.zeros(lags + 1)
    # Prewhitening: two slow series correlate by chance with each other over hundreds of samples. Filtered by
    # the errors' own autoregression, the errors are white, and the correlation at each lag has variance 1/n.
    filter_ = _autoregression(errors)
    innovations = [_filtered(piece, filter_) for piece in errors]
    inputs, inputs_p = {}, {}
    for each, pieces in courses.items():
        cross, count_of = _cross(innovations, [_filtered(piece, filter_) for piece in pieces], lags)
        inputs[each] = cross
        largest = float(np.max(np.abs(cross)))
        z = largest * math.sqrt(max(count_of, 1))
        # neither the time of a switch nor the prewhitening is exact: less is no error of the model
        inputs_p[each] = min(1.0, cross.size * math.erfc(z / math.sqrt(2.0))) if largest > _LEAST else 1.0
    white_rms, degrees = floor_of_residuals(errors, _DIFFERENCE)
    return Correlations(
        name,
        auto,
        inputs,
        INTERVAL / math.sqrt(count),
        portmanteau(errors),
        inputs_p,
        float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        white_rms,
        degrees,
    )


def _autoregression(pieces: Sequence[Floats]) -> Floats:
    """(order) coefficients of the autoregression of the pieces, by least squares."""
    usable = [piece - piece.mean() for piece in pieces if piece.size > 2 * _ORDER]
    if not usable:
        return np.zeros(_ORDER)
    past = np.vstack([_past(piece) for piece in usable])
    now = np.concatenate([piece[_ORDER:] for piece in usable])
    return np.asarray(np.linalg.lstsq(past, now, rcond=None)[0])


def _past(piece: Floats) -> Floats:
    """(n − order, order) the values 1, 2, … samples before each."""
    return np.stack([piece[_ORDER - k : -k] for k in range(1, _ORDER + 1)], axis=1)


def _filtered(piece: Floats, coefficients: Floats) -> Floats:
    """The part of each value that the autoregression does not predict."""
    away = piece - piece.mean()
    if away.size <= _ORDER:
        return np.empty(0)
    return np.asarray(away[_ORDER:] - _past(away) @ coefficients)


def _cross(errors: Sequence[Floats], inputs: Sequence[Floats], lags: int) -> tuple[Floats, int]:
    """(lags + 1) correlation of errors with the input k samples before, and the number of samples."""
    sums = np.zeros(lags + 1)
    for error, course in zip(errors, inputs, strict=True):
        size = min(error.size, course.size)
        for k in range(min(lags + 1, size)):
            sums[k] += float(error[k:size] @ course[: size - k])
    squares = sum(float(one @ one) for one in errors) * sum(float(one @ one) for one in inputs)
    count = sum(one.size for one in errors)
    return (sums / math.sqrt(squares) if squares > 0.0 else np.zeros(lags + 1)), count
