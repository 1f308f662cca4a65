"""Repeat a fit, or the noise estimate, if the refits with effects show that it was wrong.

A diagnosis compares refits with the fit of the given model, using the noise that this fit showed. If a refit
shows that either was wrong, both are repeated, and with them the diagnosis.
"""

from __future__ import annotations

import math

import numpy as np

from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import AT_LIMIT, UNSEEN
from rigctl.analysis.fitting import fit_in_noise, noise_in
from rigctl.analysis.refit import RefittedSet
from rigctl.analysis.search import Search
from rigctl.engine.least_squares import started
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.measured.noise import DataNoise, with_noise_off_model
from rigctl.noise import ChannelNoise

#: noise with a higher correlation than this may be the trace of an effect
_SLOW = 0.9


def in_noise_of_the_leader(search: Search) -> ModelComparison | None:
    """The model judged again with the noise left by the most probable effect; None if that changes nothing.

    If a test rejects a model whose error is below the noise, the noise is wrong: motion, or an effect that
    the model lacks, inflated its estimate. The residuals of the best single effect contain less of either.
    Their noise is adopted if it is smaller and no longer as slow as a signal: anything still missing beside
    that effect would appear in it as slow noise. If nothing is missing, no effect with a few parameters
    reduces the noise of thousands of readings; and if the right effect is not in the library, none makes it
    white.
    """
    before = search.before
    if not before.adequacy.below_noise:
        return None
    leader = search.best_single()
    if not leader.candidates:
        return None
    problem, noise = before.fit.problem, noise_in(before.fit)
    learned = with_noise_off_model(noise, problem.measurements, leader.fit.outputs)
    if learned is None or not _clearer(noise, learned):
        return None
    again = fit_in_noise(before.fit, learned)
    return judge(again, before.name, excluded=before.excluded)


def _clearer(noise: DataNoise, learned: DataNoise) -> bool:
    """Whether every doubtful channel is now less noisy and no longer slow, and the others are unchanged."""
    pairs = list(zip(noise.model.channels, learned.model.channels, strict=True))
    slow = [pair for pair in pairs if _slow(pair[0])]
    return bool(slow) and all(new.sigma < old.sigma and not _slow(new) for old, new in slow)


def _slow(channel: ChannelNoise) -> bool:
    return channel.guessed or channel.correlation > _SLOW


def from_another_start(search: Search) -> ModelComparison | None:
    """The model fitted again from the end of a refit whose effect is nearly nothing; None if there is none.

    A refit with one more effect may leave a local minimum in which the fit of the given model ended. If its
    effect is then within two standard deviations of its null, and χ² is significantly lower, the other
    starting point made the difference and not the effect.
    """
    before = search.before
    base = search.none
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
    return judge(judged, before.name, excluded=before.excluded)


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
