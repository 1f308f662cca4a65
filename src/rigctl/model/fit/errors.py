"""The errors of a model, channel by channel, in the channels' units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.model.fit.problem import Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ChannelError:
    """Model less measurement on one channel, SI.

    Attributes
    ----------
    rmse: root of the mean square.
    bias: mean.
    maximum: the largest in magnitude.
    noise: standard deviation of one reading; of a typical one if it is a share of the value.
    nrmse: root of the mean square in units of each reading's noise.
    chi2_reduced: mean square of the whitened residuals.
    r2: share of the readings' variance that the model explains; NaN if they are constant.
    count: how many readings counted.
    """

    rmse: float
    bias: float
    maximum: float
    noise: float
    nrmse: float
    chi2_reduced: float
    r2: float
    count: int


def channel_errors(
    problem: Problem, outputs: Sequence[Floats], indices: Sequence[int]
) -> dict[str, ChannelError]:
    """By channel, over the records at `indices`; a channel without a reading there is left out."""
    errors = {}
    white = {index: whitened_residual(problem, outputs[index], index) for index in indices}
    for column, name in enumerate(problem.measurements.outputs):
        pieces, readings, squares, sigmas = [], [], [], []
        for index in indices:
            good = problem.ok[index][:, column]
            measured = problem.records[index].values[good, column]
            pieces.append(outputs[index][good, column] - measured)
            readings.append(measured)
            sigmas.append(problem.sigma[index][good, column])
            squares.append(white[index][problem.whiteners[index].rows[:, 1] == column] ** 2)
        error, values, square, sigma = (np.concatenate(part) for part in (pieces, readings, squares, sigmas))
        if error.size:
            channel = problem.noise.channels[column]
            # where only the floor is known, the scale of the fit is what the model leaves, and no noise
            sigma = sigma * (channel.level / channel.sigma)
            errors[name] = _error(error, values, square, sigma, channel.level)
    return errors


def whitened_residual(problem: Problem, outputs: Floats, index: int) -> Floats:
    """(rows) W(f − y) of the record at `index`."""
    ok = problem.ok[index]
    values = np.where(ok, problem.records[index].values, 0.0)
    return problem.whiteners[index](np.where(ok, outputs - values, 0.0))


def _error(error: Floats, values: Floats, squares: Floats, sigma: Floats, noise: float) -> ChannelError:
    rmse = math.sqrt(float(np.mean(error**2)))
    spread = float(np.mean((values - values.mean()) ** 2))
    return ChannelError(
        rmse=rmse,
        bias=float(error.mean()),
        maximum=float(error[np.argmax(np.abs(error))]),
        noise=noise,
        nrmse=math.sqrt(float(np.mean((error / sigma) ** 2))),
        chi2_reduced=float(squares.mean()),
        r2=1.0 - rmse**2 / spread if np.ptp(values) > 0.0 else math.nan,
        count=int(error.size),
    )
