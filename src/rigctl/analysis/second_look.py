"""What the refits of effects say of the fit and the noise that they were compared with, and the same anew.

A diagnosis compares refits with the fit of the model as it is, in the noise that this fit showed. Where a
refit shows that either was wrong, both are made again, and so is the diagnosis.
"""

from __future__ import annotations

import math

import numpy as np

from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.fitting import fit_in_noise, noise_in
from rigctl.analysis.levels import AT_LIMIT, UNSEEN
from rigctl.analysis.refit import RefittedSet
from rigctl.analysis.search import Search
from rigctl.engine.least_squares import started
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.measured.noise import DataNoise, with_noise_off_model
from rigctl.noise import ChannelNoise

#: noise with a correlation above this may be what an effect leaves
_SLOW = 0.9


def in_noise_of_the_leader(search: Search) -> ModelComparison | None:
    """The model judged again in the noise that the most probable effect leaves; None where that says no more.

    Where a test rejects a model whose error is below the noise, the noise is what is wrong: motion, or what
    the model lacks, widened it. What the best of the single effects leaves holds less of either. Its noise is
    taken where it is narrower and no longer as slow as a signal: whatever is still missing beside that effect
    would show in it as slow noise. Where nothing is missing, no effect of a few parameters makes the noise of
    thousands of readings narrower, and where the right one is not in the library, none makes it white.
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
    return judge(again, before.name, excluded=before.excluded, locate=bool(before.where))


def _clearer(noise: DataNoise, learned: DataNoise) -> bool:
    """Whether every doubtful channel is narrower now and no longer slow, and the others are as they were."""
    pairs = list(zip(noise.model.channels, learned.model.channels, strict=True))
    slow = [pair for pair in pairs if _slow(pair[0])]
    return bool(slow) and all(new.sigma < old.sigma and not _slow(new) for old, new in slow)


def _slow(channel: ChannelNoise) -> bool:
    return channel.guessed or channel.correlation > _SLOW


def from_another_start(search: Search) -> ModelComparison | None:
    """The model fitted again from where a refit ended whose effect is next to nothing; None where none is.

    A refit with one effect more may leave a false minimum that the fit of the model as it is ended in. If its
    effect is then within two standard deviations of doing nothing, and χ² is lower by more than chance, the
    other start made the difference and not the effect.
    """
    before = search.before
    base = search.none
    better = [
        trial
        for trial in search.trials.values()
        if len(trial.candidates) == 1 and trial.chi2 < base.chi2 - UNSEEN and _next_to_nothing(trial)
    ]
    if not better:
        return None
    try:
        judged = _from(before.fit, min(better, key=lambda trial: trial.chi2).fit)
    except RigctlError:  # without the effect the model has no value there
        return None
    if 2.0 * _cost(judged) > base.chi2 - UNSEEN:
        return None
    return judge(judged, before.name, excluded=before.excluded, locate=bool(before.where))


def _next_to_nothing(trial: RefittedSet) -> bool:
    """Whether every size of a trial's effect is within two standard deviations of its null."""
    (candidate,) = trial.candidates
    stds = np.array([trial.value(name)[1] for name in candidate.columns])
    return bool(np.all(np.isfinite(stds)) and np.all(np.abs(trial.amplitudes(candidate)) <= AT_LIMIT * stds))


def _from(before: FitResult, there: FitResult) -> FitResult:
    """The model's fit, begun at the shared values and the records' own unknowns of another one."""
    problem = before.problem
    at = {u.name: float(value) for u, value in zip(there.problem.shared, there.values, strict=True)}
    begun = np.array([at.get(unknown.name, unknown.start) for unknown in problem.shared])
    return fit(problem.with_shared(started(problem.shared, begun)), before.held_out, local=there.local)


def _cost(fitted: FitResult) -> float:
    return math.inf if fitted.solution is None else fitted.solution.cost
