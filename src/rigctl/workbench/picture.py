"""The result of a state: curves, residuals in sigmas of the noise, and the error of every record."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.comparison_result import in_unit
from rigctl.model.fit.errors import ChannelError, channel_errors
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Picture:
    """A state on the data.

    Attributes
    ----------
    exact: all records, with the record-level parameters fitted, as in ``compare --no-fit``; otherwise these
        are as at the last release of a slider.
    records: indices of those that were simulated.
    outputs: (n, channels) of each of them, SI, by index.
    errors: (n, channels) of each of them, (model − measured)/sigma; NaN where no reading counts.
    size, bias: (records, channels) root mean square and mean of the errors; NaN of records that are not here.
    channels: the error of each channel over the records here, and of those held out.
    chi2_reduced: only of an exact one.
    failures: why a record could not be simulated, by index.
    seconds: computation time, s.
    """

    exact: bool
    records: tuple[int, ...]
    outputs: Mapping[int, Floats] = field(repr=False)
    errors: Mapping[int, Floats] = field(repr=False)
    size: Floats = field(repr=False)
    bias: Floats = field(repr=False)
    channels: Mapping[str, ChannelError]
    heldout: Mapping[str, ChannelError] = field(default_factory=dict)
    chi2_reduced: float = math.nan
    failures: Mapping[int, str] = field(default_factory=dict)
    seconds: float = 0.0

    def document(self, units: Mapping[str, str]) -> dict[str, Any]:
        """Everything but the arrays, as data for the page; `units` are the channels'."""
        return {
            "exact": self.exact,
            "records": list(self.records),
            "channels": {name: _channel(one, units[name]) for name, one in self.channels.items()},
            "heldout": {name: _channel(one, units[name]) for name, one in self.heldout.items()},
            "chi2_reduced": self.chi2_reduced if math.isfinite(self.chi2_reduced) else None,
            "failures": {str(record): why for record, why in self.failures.items()},
            "seconds": self.seconds,
        }


def _channel(error: ChannelError, unit: str) -> dict[str, Any]:
    return {**in_unit(error, unit), "nrmse": error.nrmse, "chi2_reduced": error.chi2_reduced}


def exact_picture(fitted: FitResult, seconds: float = 0.0) -> Picture:
    """The picture of a model without a fit, on all its records."""
    indices = range(len(fitted.problem.records))
    errors = {k: fitted.normalised_error(k) for k in indices}
    size, bias = _maps(errors, len(fitted.problem.records), len(fitted.problem.measurements.outputs))
    return Picture(
        True,
        tuple(indices),
        dict(enumerate(fitted.outputs)),
        errors,
        size,
        bias,
        fitted.errors,
        fitted.heldout_errors,
        fitted.chi2_reduced,
        seconds=seconds,
    )


def coarse_picture(
    problem: Problem,
    simulated: Mapping[int, Floats],
    failures: Mapping[int, str],
    fitted: Sequence[int],
    seconds: float = 0.0,
) -> Picture:
    """The picture of the simulated records; `fitted` are the indices of those not held out."""
    # Weighted as in a fit, (model − measured)/σ, but without refitting anything: at coarse pictures the
    # record-level parameters are those of the last exact one.
    errors = {}
    for k, outputs in simulated.items():
        error = (outputs - problem.records[k].values) / problem.sigma[k]
        errors[k] = np.where(problem.ok[k], error, np.nan)
    size, bias = _maps(errors, len(problem.records), len(problem.measurements.outputs))
    complete = [k for k in simulated if k not in failures]
    used, heldout = [k for k in complete if k in fitted], [k for k in complete if k not in fitted]
    everything = [simulated.get(k, np.empty((0, 0))) for k in range(len(problem.records))]
    return Picture(
        False,
        tuple(simulated),
        dict(simulated),
        errors,
        size,
        bias,
        channel_errors(problem, everything, used) if used else {},
        channel_errors(problem, everything, heldout) if heldout else {},
        failures=failures,
        seconds=seconds,
    )


def _maps(errors: Mapping[int, Floats], records: int, channels: int) -> tuple[Floats, Floats]:
    """(records, channels) root mean square and mean; NaN where there is nothing."""
    size, bias = np.full((2, records, channels), np.nan)
    for k, error in errors.items():
        finite = np.isfinite(error)
        count = finite.sum(axis=0)
        some = count > 0
        clean = np.where(finite, error, 0.0)
        size[k, some] = np.sqrt(np.square(clean).sum(axis=0)[some] / count[some])
        bias[k, some] = clean.sum(axis=0)[some] / count[some]
    return size, bias
