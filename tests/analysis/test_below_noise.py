"""If a test rejects an error below the noise, the verdict is undecided."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from made_fit import made_fit, made_noise
from rigctl.analysis.agreement.adequacy import Adequacy, Test
from rigctl.analysis.comparison import judge
from rigctl.analysis.conclusion import Doubt, conclude
from rigctl.analysis.diagnosis import diagnose_comparison
from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.analysis.fitting import fit_model
from rigctl.analysis.improve import Improvement, ImprovementEnd, _plan, _why
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.score_test import Score
from rigctl.analysis.search.judgement import verdict_on
from rigctl.analysis.search.ranking import _factor, _ranked, _score_beside
from rigctl.analysis.search.reasons import reasons_against
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.remainder import Remainder
from rigctl.analysis.search.search import Search
from rigctl.answers.findings.verdict import worded
from rigctl.effects.registry import library
from rigctl.files.shipped import shipped
from rigctl.model.fit.fit import FitResult
from rigctl.model.load import load_model
from rigctl.model.measured.noise import noise_of
from rigctl.physics.families import find_family
from rigctl.rig.load import load_rig
from rigctl_validation.hidden_effect import hide
from rigctl_validation.hidden_library import find_hidden
from rigctl_validation.in_memory import measure
from rigctl_validation.scenario import Scenario

LEAK = library(find_family("hydraulic_cylinder"))["valve_leakage"]
LEAKS = 6e-15
REJECTS = {"plane": Test(240.0, 1e-30, 10, 4.5), "chi2": Test(900.0, 1.0, 1200, 50.0)}


def member(name: str) -> Candidate:
    return cast("Candidate", SimpleNamespace(name=name, effect=LEAK, columns=(f"{name}.x",), shapes={}))


def searched(
    adequacy: Adequacy, chosen: tuple[Candidate, ...], fit: Any = None
) -> tuple[Search, RefittedSet]:
    """A search whose best set explains 600 in χ² and leaves residuals with these test results."""
    before: Any = SimpleNamespace(adequacy=Adequacy(REJECTS), adequate=False)
    search = Search(before, cast("Any", None))
    search.null = RefittedSet((), cast("FitResult", None), 1500.0, 0)
    best = RefittedSet(chosen, cast("FitResult", fit), 900.0, len(chosen))
    here: Any = SimpleNamespace(
        adequacy=adequacy,
        linearisation=SimpleNamespace(candidates=()),
        screening=SimpleNamespace(scores=()),
        view=lambda _: here,  # no law is changed by the shape tolerance
        scatter=lambda _: None,  # and no size scatters
    )
    search.tolerance, search.null_tests, search.in_own_scale = 0.1, before, False
    search.at = lambda _: here  # type: ignore[method-assign]
    return search, best


@pytest.mark.parametrize("below", [False, True])
def test_the_excess_of_a_rejected_set_remains_when_its_error_is_below_the_noise(below: bool) -> None:
    """A wrong effect reduces the error from 1.2 to 0.85 of an overestimated noise; the tests give 1e-30."""
    search, best = searched(Adequacy(REJECTS, below_noise=below), (member("valve_leakage"),))
    assert search.excess(best) == pytest.approx(240.0 - 10 - 2.33 * 4.5)
    assert search.left(best) > 0.2
    assert not search.sure(best)
    assert search.left(search.null) == 1.0


def test_differences_weigh_less_where_the_tests_reject_an_error_below_the_noise() -> None:
    fit = made_fit(made_noise(), 1, lambda _, times: 0.5 * np.sin(0.1 * times))
    search, best = searched(Adequacy(REJECTS, below_noise=True), (member("valve_leakage"),), fit)
    assert _factor(search, best) > 10.0


def test_a_set_with_an_error_below_the_noise_is_at_most_ambiguous_and_states_its_remainder() -> None:
    little = {"plane": Test(25.0, 0.002, 10, 4.5), "chi2": REJECTS["chi2"]}
    search, best = searched(Adequacy(little, below_noise=True), (member("valve_leakage"),))
    assert search.sure(best)
    left = Remainder(0.007, 2.0, 0.004, "", "", "", below_noise=True)
    quiet = SimpleNamespace(problem=SimpleNamespace(noise=SimpleNamespace(channels=())), solution=None)
    best = cast(
        "RefittedSet",
        SimpleNamespace(candidates=best.candidates, unusual={}, undetermined=(), chi2=best.chi2, fit=quiet),
    )
    assert verdict_on(search, best, [], {}, replace(left, below_noise=False)) is Verdict.MISSING_EFFECT
    assert verdict_on(search, best, [], {}, left) is Verdict.AMBIGUOUS
    chosen: Any = [(SimpleNamespace(effect=LEAK), SimpleNamespace(parameters={}))]
    against = reasons_against(best, {}, left)
    said = worded(conclude("ambiguous", chosen, [], left, {}, against=against)).text
    assert "the noise of these readings differs from the assumed one: " in said
    assert said.endswith("That is not all: 0.7 % of the misfit is left (p = 0.004)")
    assert left.document()["below_noise"] is True


def test_a_member_whose_complement_cannot_be_fitted_is_ranked_with_its_own_parameters() -> None:
    chosen = (member("first"), member("valve_leakage"))
    fit: Any = SimpleNamespace(std={"valve_leakage.x": 0.0})
    search, _ = searched(Adequacy(REJECTS), chosen, fit)
    others = (member("another"), *chosen)
    search.before = cast("Any", SimpleNamespace(linearisation=SimpleNamespace(candidates=others)))
    search.explained = lambda *_: 0.0  # type: ignore[method-assign]
    search.price = lambda one: 1.0 * others.index(one)  # type: ignore[method-assign]
    beside: Any = SimpleNamespace(without=lambda _: SimpleNamespace(kappa=np.array([0.5])))
    search.at = lambda _: beside  # type: ignore[method-assign]
    parameter = replace(LEAK.parameters[0], unit="m^3")
    held: Any = SimpleNamespace(
        name="valve_leakage",
        effect=replace(LEAK, parameters=()),
        columns=("valve_leakage.x",),
        parameter=lambda _: parameter,
    )
    found: Any = SimpleNamespace(
        effects=("first", "valve_leakage"),
        candidates=(chosen[0], held),
        amplitudes=lambda _: np.array([4e-15]),
        reported=lambda _: (4e-15, 1e-16),
        fit=SimpleNamespace(problem=SimpleNamespace(shared=()), values=np.empty(0)),
    )
    score = _score_beside(search, found, "valve_leakage")
    assert others[score.candidate].name == "valve_leakage"
    ranked = _ranked(search, found, score, 0.5)
    assert ranked.delta_bic == 2.0
    (shown,) = ranked.parameters.values()
    assert (shown.value, shown.std) == (4e-15, 1e-16)
    assert isinstance(score, Score)


@pytest.mark.parametrize("verdict", [Verdict.ADEQUATE, Verdict.OUTSIDE_LIBRARY])
def test_no_effect_is_added_while_it_is_undecided_whether_one_is_missing(verdict: Verdict) -> None:
    """The set improves the fit, but no version is saved on inconclusive data."""
    before = SimpleNamespace(adequate=False, explained_by=None)
    found = cast(
        "Diagnosis",
        SimpleNamespace(verdict=verdict, doubt=Doubt("within_noise"), best=None, before=before, model="m"),
    )
    assert _plan(found, 4) == []
    assert _why(found, 4) is ImprovementEnd.NOT_DECIDED
    said = Improvement(cast("Any", None), (), found, ImprovementEnd.NOT_DECIDED).statement
    assert said == (
        "added nothing: these data cannot tell whether anything is missing: the error of every channel is "
        "within its noise"
    )


def test_noise_assumed_three_times_too_large_is_taken_back() -> None:
    """An effect of 20 sigmas lies below this noise; the verdict was "Adequate", with detection limits.

    Once a model says where the bench rests, the readings there show the noise, whatever was assumed.
    """
    scenario = Scenario("nothing", repeated=1, temperatures=(20.0, 60.0), pressures=(50.0,), seed=3)
    campaign = hide(scenario.plain, [(find_hidden("valve_leakage"), LEAKS)], "other")
    model = load_model(shipped("models", "hl32-textbook.yaml"))
    measurements = measure(campaign, model, load_rig(shipped("rigs", "hl32-bench.yaml")))
    learned = noise_of(measurements)
    wide = tuple(replace(one, sigma=3.0 * one.sigma) for one in learned.model.channels)
    fitted = fit_model(model, measurements, replace(learned, model=replace(learned.model, channels=wide)))
    before = judge(fitted, model.name)
    found = diagnose_comparison(before)
    assert not before.adequacy.below_noise
    for channel, right in zip(before.fit.problem.noise.channels, learned.model.channels, strict=True):
        assert channel.standing == "measured"
        assert channel.sigma == pytest.approx(right.sigma, rel=0.05)
    assert found.verdict is Verdict.MISSING_EFFECT
    assert list(found.best.effects) == ["valve_leakage"]
    assert not [one for one in found.evidence if one.quantity == "power"]
