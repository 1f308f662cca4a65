"""Repeat a fit, or change the scale of its errors, if the refits with effects show that it was wrong.

A diagnosis compares refits with the fit of the given model, in the scale of the errors that this fit showed.
If a refit shows that either was wrong, both are repeated, and with them the diagnosis.
"""

from __future__ import annotations

import math

import numpy as np

from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import AT_LIMIT, UNSEEN
from rigctl.analysis.fitting import fit_in_noise, noise_in
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.search import Search
from rigctl.engine.least_squares import started
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.measured.noise import DataNoise
from rigctl.model.measured.standing import with_what_is_left

#: the scale of what is left counts as smaller below this share of it
_SMALLER = 0.85


def in_scale_of(
    search: Search, leader: RefittedSet, *, independent: bool = False, larger: bool = False
) -> ModelComparison | None:
    """The model judged again in the scale of what a leader leaves; None if that is nearly the same.

    Where only the white floor of a noise is known, what a model leaves is the scale of its errors. A model
    that lacks something leaves much, and slowly: in its own scale no effect would seem to matter. What the
    nearest effect leaves is an upper bound of the noise, as of every model with few parameters. In that scale
    a gain is ``(Σe₀²/Σe₁² − 1)·n/τ``, with the residuals e₀ of the model, e₁ and their correlation time τ of
    the leader: large only if the effect makes the misfit collapse, whatever the noise is.

    Parameters
    ----------
    independent: count every reading as independent, τ = 1: a scale in which to look for the leader only.
    larger: take a larger scale too, after such a search.
    """
    before = search.before
    noise, problem = noise_in(before.fit), before.fit.problem
    learned = with_what_is_left(
        noise,
        problem.measurements,
        leader.fit.outputs,
        leader.fit.fitted,
        unknowns=leader.fit.unknowns,
        independent=independent,
    )
    if learned is None or not (larger or _smaller(noise, learned)):
        return None
    return judge(fit_in_noise(before.fit, learned), before.name, excluded=before.excluded, sensors=False)


def _smaller(noise: DataNoise, learned: DataNoise) -> bool:
    """Whether the scale of some channel is now considerably smaller."""
    pairs = zip(noise.model.channels, learned.model.channels, strict=True)
    return any(new.sigma < _SMALLER * old.sigma for old, new in pairs)


def from_another_start(search: Search) -> ModelComparison | None:
    """The model fitted again from the end of a refit whose effect is nearly nothing; None if there is none.

    A refit with one more effect may leave a local minimum in which the fit of the given model ended. If its
    effect is then within two standard deviations of its null, and χ² is significantly lower, the other
    starting point made the difference and not the effect.
    """
    before = search.before
    base = search.null
    better = [
        trial
        for trial in search.trials.values()
        if len(trial.candidates) == 1 and trial.chi2 < base.chi2 - UNSEEN and _near_null(trial)
    ]
    if not better:
        return None
    try:
        judged = _from(before.fit, min(better, key=lambda trial: trial.chi2).fit)
    except RigctlError:  # the model cannot be simulated there without the effect
        return None
    if 2.0 * _cost(judged) > base.chi2 - UNSEEN:
        return None
    return judge(judged, before.name, excluded=before.excluded, sensors=False)


def _near_null(trial: RefittedSet) -> bool:
    """Whether every parameter of a trial's effect is within two standard deviations of its null."""
    (candidate,) = trial.candidates
    stds = np.array([trial.value(name)[1] for name in candidate.columns])
    return bool(np.all(np.isfinite(stds)) and np.all(np.abs(trial.amplitudes(candidate)) <= AT_LIMIT * stds))


def _from(before: FitResult, other: FitResult) -> FitResult:
    """The model's fit, started at the shared and record-level values of another fit."""
    problem = before.problem
    at = {u.name: float(value) for u, value in zip(other.problem.shared, other.values, strict=True)}
    start = np.array([at.get(unknown.name, unknown.start) for unknown in problem.shared])
    return fit(problem.with_shared(started(problem.shared, start)), before.held_out, local=other.local)


def _cost(fitted: FitResult) -> float:
    return math.inf if fitted.solution is None else fitted.solution.cost
