"""A diagnosis is repeated if its refits show that the noise was wrong, or the fit in a local minimum."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigctl.analysis.comparison import judge
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.fitting import fit_to_data, read_runs
from rigctl.analysis.linear.candidates import candidates
from rigctl.analysis.search.refit import refit
from rigctl.analysis.search.repeated_fit import from_another_start, in_scale_of
from rigctl.analysis.search.search import Search
from rigctl.dataset import open_run
from rigctl.dataset.importing.bring_in import import_file
from rigctl.model.fit.fit import FitResult, fit
from rigctl.model.load import load_model
from rigctl.rig.load import load_rig
from rigctl_validation.benches.bench import BenchCampaign, write_bench
from rigctl_validation.benches.register import find_bench


def fitted(campaign: BenchCampaign, folder: Path) -> FitResult:
    log = write_bench(campaign, folder)
    imported = import_file(log, load_rig(folder / "rig.yaml"), folder / "runs")
    model = load_model(folder / "model.yaml")
    return fit_to_data(model, read_runs(model, [open_run(imported.path)]))


def search_of(found: FitResult, *, among: Collection[str] = ()) -> Search:
    """The search, among some of the effects or all of them."""
    names = {one.name for one in candidates(found.model)}
    excluded = names - set(among) if among else ()
    before = judge(found, "spring", excluded=excluded)
    return Search(before, before.whole)


def test_errors_are_judged_in_the_scale_of_what_the_nearest_effect_leaves(tmp_path: Path) -> None:
    """Five readings to a time constant, noise that grows fourfold: slow noise or dry friction?"""
    campaign = BenchCampaign(find_bench("spring"), 0.0156, "five", False, "level", 101)
    search = search_of(fitted(campaign, tmp_path), among=("coulomb_on_velocity", "gain_of_position"))
    assert search.in_own_scale
    assert not search.before.adequacy.below_noise
    nearest = search.nearest()
    assert nearest.effects == campaign.bench.hidden.counts_as
    again = in_scale_of(search, nearest)
    assert again is not None
    assert not again.adequate
    assert (
        again.fit.problem.noise.channels[0].sigma < 0.85 * search.before.fit.problem.noise.channels[0].sigma
    )


@pytest.fixture(scope="module")
def nothing_hidden(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return fitted(BenchCampaign(find_bench("spring"), 0.0, "five", seed=3), tmp_path_factory.mktemp("spring"))


def in_false_minimum(found: FitResult) -> FitResult:
    """The same model, held at the far side of a stiffness that is too small."""
    problem = found.problem
    shared = [
        replace(one, start=0.6 * one.start, upper=0.7 * one.start) if one.name == "stiffness" else one
        for one in problem.shared
    ]
    away = fit(problem.with_shared(shared))
    return replace(away, problem=problem)


def trial_at(search: Search, name: str, begin: FitResult) -> None:
    """Refit with one effect, begun where another fit ended."""
    lin = search.before.linearisation
    candidate = next(one for one in lin.candidates if one.name == name)
    found = refit(search.before.fit, (candidate,), begin)
    assert found is not None
    search.trials[name,] = found


def test_a_fit_in_a_local_minimum_is_repeated_from_a_better_refit_with_an_inactive_effect(
    nothing_hidden: FitResult,
) -> None:
    search = search_of(in_false_minimum(nothing_hidden))
    assert not search.before.adequate
    trial_at(search, "gain_of_position", nothing_hidden)
    again = from_another_start(search)
    assert isinstance(again, ModelComparison)
    assert again.adequate
    assert again.fit.values == pytest.approx(nothing_hidden.values, rel=0.02, abs=0.02)


def test_a_fit_that_no_inactive_effect_improves_is_kept(nothing_hidden: FitResult) -> None:
    search = search_of(nothing_hidden)
    trial_at(search, "gain_of_position", nothing_hidden)
    assert from_another_start(search) is None


def test_a_model_that_leaves_its_noise_has_no_smaller_scale(nothing_hidden: FitResult) -> None:
    search = search_of(nothing_hidden)
    assert search.before.adequate
    assert in_scale_of(search, search.null) is None
    assert np.isfinite(search.null.chi2)
