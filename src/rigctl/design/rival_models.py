"""The question for the next experiment if a user gives several models: which of them is right.

In: runs and models. Out: a `Question` between those models that the data leave. They have no common base
here, as effects of a library have: the prior weight of each is that of any other, and its penalty is that of
all parameters which its fit may change, those of single records included (``Σ ln n``, with the samples of
all records, or of the one). All are fitted in the same noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigctl.analysis.decision_levels import ODDS
from rigctl.analysis.fitting import OnProgress, fit_in_noise, fit_to_data, no_progress, noise_in, read_runs
from rigctl.analysis.linear.mbic import effective_samples
from rigctl.analysis.search.refit import plain
from rigctl.dataset.run import Run
from rigctl.design.criterion import Discrimination
from rigctl.design.information_so_far import known_so_far
from rigctl.design.power import Gain
from rigctl.design.refusals import NothingLeft
from rigctl.design.result import HALF
from rigctl.design.rivals import Basis, Question, Rival, weighed
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.measured.record import Measurements
from rigctl.model.model import Model
from rigctl.wording import listed

#: an error that counts as this, SI, is none
_LEAST = 1e-300


def question_between(
    runs: Sequence[Run],
    models: Sequence[Model],
    *,
    hold_out: str | None = None,
    only: str | None = None,
    on_progress: OnProgress = no_progress,
) -> tuple[Basis, Question]:
    """Which of the models is right, among those that the data so far do not exclude.

    A model is excluded by the most probable one if the two are distinguished as a verdict requires it of two
    effects: by odds of 100 to 1, and by a separation.

    Raises
    ------
    NothingLeft
        a single model is left.
    RigctlError
        the models do not describe one bench, or one cannot be fitted.
    """
    _require_different_names(models)
    read = [read_runs(one, runs, hold_out=hold_out, only=only, on_progress=on_progress) for one in models]
    _require_one_bench(models, [one.measurements for one in read])
    fits = [fit_to_data(one, data, on_progress=on_progress) for one, data in zip(models, read, strict=True)]
    rivals = weighed([_rival(one) for one in _in_one_noise(fits, on_progress)], most=len(fits))
    left = _not_excluded(rivals)
    if len(left) < 2:
        others = listed([one.name for one in rivals[1:]])
        raise NothingLeft(
            f"nothing is left to distinguish: the odds of {left[0].name} against {others} are more than "
            "100 to 1",
            value=left[0].name,
        )
    question = _between(tuple(left))
    if not question.pairs:
        raise NothingLeft(
            f"nothing is left to distinguish: {listed([one.name for one in left])} are the same model",
            value=left[0].name,
        )
    total = math.fsum(one.weight for one in left)
    kept = {one.name for one in left}
    basis = Basis(
        runs=tuple(run.id for run in runs),
        model=" or ".join(one.name for one in left),
        excluded=tuple(one.name for one in models if one.name not in kept),
    )
    weighted = tuple(replace(one, weight=one.weight / total) for one in left)
    return basis, replace(question, rivals=weighted)


def _in_one_noise(fits: Sequence[FitResult], on_progress: OnProgress) -> list[FitResult]:
    """All models in the noise that the one with the least error leaves: squares are comparable only then."""

    def size(fitted: FitResult) -> float:
        return sum(math.log(max(one.rmse, _LEAST)) for one in fitted.errors.values())

    least = min(fits, key=size)
    return [
        one
        if one.problem.noise == least.problem.noise
        else fit_in_noise(one, noise_in(least), on_progress=on_progress)
        for one in fits
    ]


def _not_excluded(rivals: tuple[Rival, ...]) -> list[Rival]:
    """The most probable one, and those from which the data so far do not distinguish it."""
    best, *others = rivals
    every = Discrimination(_between(rivals), known_so_far(rivals))
    nothing, nowhere = Gain(np.zeros(1), np.zeros(1)), np.zeros((len(rivals), len(rivals)))
    # also those whose odds are less if the noise is as wide as the best one leaves it
    return [
        best,
        *(
            one
            for k, one in enumerate(others, 1)
            if one.weight * ODDS > best.weight or every.of_pair((0, k), nothing, nowhere) < HALF
        ),
    ]


def _between(rivals: tuple[Rival, ...]) -> Question:
    """All pairs (truth, rival), but for a rival that is the truth with something more: nothing shows that
    this is not there."""
    pairs = tuple(
        (i, j)
        for i, truth in enumerate(rivals)
        for j, rival in enumerate(rivals)
        if i != j and not rival.contains(truth)
    )
    return Question("discrimination", rivals, pairs, len(rivals))


def _rival(fitted: FitResult) -> Rival:
    trial = plain(fitted)
    problem = fitted.problem
    penalty = len(problem.shared) * math.log(effective_samples(fitted))
    for k in fitted.fitted:
        free = sum(one.unknown.prior is None for one in problem.local[k])
        penalty += free * math.log(max(int(problem.ok[k].sum()), 1))
    return Rival(fitted.problem.model.name, trial, trial.chi2 + penalty, weight=1.0)


def _require_different_names(models: Sequence[Model]) -> None:
    names = [one.name for one in models]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RigctlError("two of the models have the same name", value=twice, expected="different names")


def _require_one_bench(models: Sequence[Model], read: Sequence[Measurements]) -> None:
    """The models read the same channels, and are driven by the same inputs."""
    for model, measured in zip(models[1:], read[1:], strict=True):
        for what in ("inputs", "outputs"):
            mine, its = getattr(read[0], what), getattr(measured, what)
            if mine != its:
                raise RigctlError(
                    f"{models[0].name} and {model.name} are not of one bench: their {what} differ",
                    value=", ".join(its),
                    expected=f"{', '.join(mine)}, in this order",
                )
