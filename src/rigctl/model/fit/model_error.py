"""The error of a fitted model as recorded in its history."""

from __future__ import annotations

from rigctl.model.fit.fit import FitResult
from rigctl.model.history.change import ModelError
from rigctl.units import parse_unit


def model_error(fit: FitResult) -> ModelError:
    """Root mean square error of each channel, fitted and held out, and the noise as its lower limit.

    In the units in which the channels are shown; for a temperature in kelvin. Without χ² where a channel's
    noise is known only as a floor: what a model leaves is then its own scale, and χ² compares no two models.
    """
    measurements = fit.problem.measurements
    shown = dict(zip(measurements.outputs, measurements.units, strict=True))
    units = {name: "K" if parse_unit(unit).offset else unit for name, unit in shown.items()}
    return ModelError.from_si(
        {name: error.rmse for name, error in fit.errors.items()},
        units,
        heldout_rmse={name: error.rmse for name, error in fit.heldout_errors.items()},
        chi2_reduced=None if fit.problem.noise.own_scale else fit.chi2_reduced,
        noise={name: error.noise for name, error in fit.errors.items()},
    )
