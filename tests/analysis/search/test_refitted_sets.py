"""Sets that are fitted again, or put aside, on a linear problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from linear_problem import PLAIN, compared, made_design
from rigctl.analysis.decision_levels import BEYOND_LAWS, BEYOND_SHAPE, LEAST_DIFFERENCE, UNSEEN
from rigctl.analysis.linear.size_scatter import SizeScatter
from rigctl.analysis.search import refitted_sets
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.rivals import find_rivals
from rigctl.analysis.search.search import Search


@pytest.fixture
def search() -> Search:
    """alpha and beta nearly the same, and beta is in the data."""
    gram = np.eye(len(PLAIN))
    gram[0, 1] = gram[1, 0] = 0.98
    design = made_design(PLAIN, gram)
    before = compared(design, design.readings({"beta.size": 12.0}, design.typical_noise()))
    return Search(before, before.whole)


def single(search: Search, name: str) -> RefittedSet:
    lin = search.before.linearisation
    found = search.refitted([next(one for one in lin.candidates if one.name == name)], search.null)
    assert found is not None
    return found


def test_a_deeper_minimum_of_a_set_is_what_its_rivals_are_compared_with(
    search: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    alpha, beta = single(search, "alpha"), single(search, "beta")
    ((before, *_),) = [one for one in search.rivals(beta, beta.candidates[0]) if one[0].effects == ("alpha",)]
    assert before is alpha
    deeper = replace(alpha, chi2=alpha.chi2 - 2.0 * UNSEEN)
    with monkeypatch.context() as patch:
        patch.setattr(refitted_sets, "refit", lambda *_, **__: deeper)
        patch.setattr(Search, "of_few_rows", False)  # a table's fits are not repeated
        assert search.refitted_also_from(alpha.candidates, beta) is deeper
    ((after, *_),) = [one for one in search.rivals(beta, beta.candidates[0]) if one[0].effects == ("alpha",)]
    assert after is deeper


def test_the_model_as_given_has_no_rivals_though_a_set_was_put_aside(search: Search) -> None:
    search.unusual_best = single(search, "alpha")
    assert find_rivals(search, search.null) == []


def pair(search: Search, *names: str) -> RefittedSet:
    candidates = search.before.linearisation.candidates
    found = search.refitted([one for one in candidates if one.name in names], search.null)
    assert found is not None
    return found


def with_tolerance(
    search: Search,
    monkeypatch: pytest.MonkeyPatch,
    evidence: Mapping[tuple[str, ...], float],
    excess: Mapping[tuple[str, ...], float],
) -> None:
    """The search with a shape tolerance, and these results of the tests with the discrepancies integrated
    out."""
    search.tolerance = 0.1
    monkeypatch.setattr(Search, "evidence", lambda _, trial: evidence[trial.effects])
    monkeypatch.setattr(Search, "excess", lambda _, trial: excess.get(trial.effects, 0.0))


@pytest.mark.parametrize(
    ("share", "reached", "left", "kept"),
    [
        (0.9 * BEYOND_SHAPE, 1e5, 0.0, False),
        (1.1 * BEYOND_SHAPE, 1e5, 0.0, True),
        (0.9 * BEYOND_LAWS, 2000.0, 0.0, False),
        (1.1 * BEYOND_LAWS, 2000.0, 0.0, True),
        (0.9 * BEYOND_LAWS, 2000.0, 1e4, True),
    ],
)
def test_a_member_is_kept_for_what_it_explains_beyond_the_others_shape_tolerance(
    search: Search,
    monkeypatch: pytest.MonkeyPatch,
    share: float,
    reached: float,
    left: float,
    kept: bool,
) -> None:
    """A larger share is required of a small one; of others hardly any, and only if the rest leaves little."""
    alpha, both = single(search, "alpha"), pair(search, "alpha", "beta")
    alpha = replace(alpha, chi2=both.chi2 + 1000.0)
    evidence = {alpha.effects: 1000.0 * share, both.effects: 0.0}
    with_tolerance(search, monkeypatch, evidence, {alpha.effects: left})
    search.null_tests = search.before  # the model has no effects
    monkeypatch.setattr(Search, "_size_scatter", lambda *_: None)
    assert search.slight(both, alpha, reached) is not kept


def test_beside_a_tolerance_a_pair_that_leaves_nothing_goes_before_a_lower_mbic(
    search: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    lower, complete = pair(search, "alpha", "beta"), pair(search, "beta", "gamma")
    complete = replace(complete, chi2=lower.chi2 + 20.0)
    evidence = {lower.effects: 100.0, complete.effects: 20.0}
    with_tolerance(search, monkeypatch, evidence, {lower.effects: 60.0})
    assert search._complete_before_least([lower, complete]) is complete
    evidence[complete.effects] = 120.0
    assert search._complete_before_least([lower, complete]) is lower
    with_tolerance(search, monkeypatch, {**evidence, complete.effects: 20.0}, {})
    assert search._complete_before_least([lower, complete]) is lower


@pytest.mark.parametrize(("worse", "rivals"), [(2.0 * LEAST_DIFFERENCE, []), (0.0, ["beta", "gamma"])])
def test_a_pair_is_a_rival_of_one_effect_only_if_discrepancies_do_not_distinguish_them(
    monkeypatch: pytest.MonkeyPatch, worse: float, rivals: list[str]
) -> None:
    """Its χ² is lower with the laws exactly as declared: the scatter of a delay is then not explained."""
    gram = np.eye(len(PLAIN))
    gram[0, 1] = gram[1, 0] = gram[0, 2] = gram[2, 0] = 0.7
    design = made_design(PLAIN, gram)
    readings = design.readings({"beta.size": 30.0, "gamma.size": 30.0}, design.typical_noise())
    before = compared(design, readings)
    search = Search(before, before.whole)
    alpha, both = single(search, "alpha"), pair(search, "beta", "gamma")
    assert search.mbic(both) < search.mbic(alpha)
    with_tolerance(search, monkeypatch, {alpha.effects: 0.0, both.effects: worse}, {})
    monkeypatch.setattr(Search, "rivals", lambda *_: [])
    monkeypatch.setattr(Search, "sure", lambda *_: True)
    found = [one for one in find_rivals(search, alpha) if one.beside]
    assert [one.name for one in found] == rivals


@pytest.mark.parametrize(("counts", "left"), [(True, 60.0 / 2660.0), (False, 60.0 / 660.0)])
def test_what_the_scatter_of_a_size_explains_is_not_left(
    search: Search, monkeypatch: pytest.MonkeyPatch, counts: bool, left: float
) -> None:
    """Fitted parameters have absorbed the mean of a delay that differs from switch to switch."""
    alpha = single(search, "alpha")
    alpha = replace(alpha, chi2=search.null.chi2 - 600.0)
    scatter = SizeScatter("alpha", 0.2, asked=True, follows=False, explained=2000.0, counts=counts)
    shaped = SimpleNamespace(shapes=("size of alpha in record 0, 0",))
    point: Any = SimpleNamespace(scatter=lambda _: scatter, shaped=lambda: shaped)
    with_tolerance(search, monkeypatch, {}, {alpha.effects: 60.0})
    monkeypatch.setattr(Search, "at", lambda *_: point)
    assert search.left(alpha) == pytest.approx(left)
