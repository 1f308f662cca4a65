"""Fit a model to runs, and fit another to the same records."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.compare.compare import Tell, fit_model
from rigctl.compare.localise import variable_units
from rigctl.dataset.run import Run
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.hold_out import held_out
from rigctl.model.measured.noise import DataNoise, noise_of
from rigctl.model.measured.read import read_measurements
from rigctl.model.model import Model


def fit_to_runs(
    model: Model,
    runs: Sequence[Run],
    *,
    hold_out: str | None = None,
    refit: bool = True,
    tell: Tell | None = None,
) -> FitResult:
    """Fit a model's free parameters to the usable records of `runs`.

    Parameters
    ----------
    hold_out: a condition that chooses the records that the fit does not see, e.g. ``oil == 60 degC``.
    refit: False takes the parameters as they are.
    tell: told what is being done.

    Raises
    ------
    RigctlError
        as `rigctl.compare.compare.compare`.
    """
    if tell is not None:
        tell("Reading the records")
    measurements = read_measurements(model, runs)
    noise = noise_of(measurements)
    out = held_out(measurements, hold_out, variable_units(measurements))
    if tell is not None:
        tell(f"Fitting {model.name}" if refit else f"Simulating {model.name}")
    return fit_model(model, measurements, noise, out, refit=refit, tell=tell)


def fit_again(before: FitResult, model: Model, *, refit: bool = True, tell: Tell | None = None) -> FitResult:
    """Fit another model to the data of `before`, with the same noise and the same records held out."""
    problem = before.problem
    data = DataNoise(problem.noise, problem.ok)
    return fit_model(model, problem.measurements, data, before.held_out, refit=refit, tell=tell)


def require_free_parameters(model: Model) -> None:
    """Require that the model has something to fit.

    Raises
    ------
    RigctlError
        it has not.
    """
    if not model.fitted:
        raise RigctlError(
            f"the model '{model.name}' has nothing to fit: any misfit of its numbers would look like "
            "missing physics",
            hint="Mark the parameters that are not known exactly with 'fit: true' in the model file",
        )
