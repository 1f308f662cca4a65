"""Whether a model agrees with the data beyond a bound that a user wrote and that holds its fit.

Where it does, the misfit is that of the bound, and an effect that explains it would only imitate a parameter
that was not allowed to have its value.
"""

from __future__ import annotations

from contextlib import suppress

from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.fitting import fit_in_noise, noise_in
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.fit.reached_bounds import beyond_written
from rigctl.model.measured.standing import with_what_is_left


def agreeing_beyond(before: ModelComparison) -> ModelComparison | None:
    """The model fitted with wider bounds, if it agrees with the data then.

    None if it agrees as it is, if no bound of a user holds it, or if wider bounds do not help.
    """
    if before.adequate or not before.bounded:
        return None
    with suppress(RigctlError):  # the model cannot be simulated there
        beyond = judge(_fitted_beyond(before.fit), before.name, excluded=before.excluded, sensors=False)
        return beyond if beyond.adequacy.agrees else None
    return None


def values_beyond(before: ModelComparison, beyond: ModelComparison) -> tuple[tuple[str, float, str], ...]:
    """The parameters that a bound holds, with the values, SI, and units that they have beyond it."""
    ended = {one.name: float(v) for one, v in zip(beyond.fit.problem.shared, beyond.fit.values, strict=True)}
    return tuple((one.parameter, ended[one.parameter], one.unit) for one in before.bounds if one.decisive)


def _fitted_beyond(fitted: FitResult) -> FitResult:
    """The fit with the bounds that hold it moved outwards, in the noise that it leaves then."""
    shared = beyond_written(fitted)
    assert shared is not None  # noqa: S101 - a bound holds it
    wider = fit(fitted.problem.with_shared(shared), fitted.held_out, local=fitted.local)
    left = with_what_is_left(
        noise_in(wider), wider.problem.measurements, wider.outputs, wider.fitted, unknowns=wider.unknowns
    )
    return wider if left is None else fit_in_noise(wider, left)
