"""The levels of verdicts: those that follow from statistics, and empirical ones at their edges."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import norm

from rigctl.analysis import decision_levels as levels
from rigctl.analysis.search import rivals
from rigctl.analysis.search.reasons import reasons_against
from rigctl.analysis.search.refit import RefittedSet
from rigctl.analysis.search.refitted_sets import RefittedSets
from rigctl.analysis.search.remainder import Remainder
from rigctl.analysis.search.search import Search
from rigctl.discovery.result import FoundFormula


def test_quantiles_follow_from_the_probability_of_a_false_alarm() -> None:
    assert levels.ALPHA == levels.SURVEY_ALPHA == 0.01  # 1 %, as every page says
    assert levels.QUANTILE == levels.LEAST_SEPARATION == round(norm.isf(levels.ALPHA), 2)
    assert round(norm.ppf(0.975), 2) == levels.INTERVAL


def test_odds_and_a_difference_of_mbic_are_the_same_evidence() -> None:
    assert round((1.0 - levels.ALPHA) / levels.ALPHA, -1) == levels.ODDS
    assert round(-2.0 * math.log(1.0 / levels.ODDS), 1) == levels.LEAST_DIFFERENCE
    assert round(math.exp(levels.SLOT_SEPARABLE)) == 20  # to 1


def test_an_effect_that_no_test_sees_adds_the_square_of_its_size() -> None:
    """Detected with probability 0.8 in a library of 12 effects and 0.7 in one of 50, beside two tests."""
    for library, power in ((12, 0.8), (50, 0.7)):
        found = norm.sf(norm.isf(0.5 * levels.ALPHA / 3.0 / library) - levels.SEEN_IN_LIBRARY)
        assert found == pytest.approx(power, abs=0.02)
    assert round(levels.SEEN_IN_LIBRARY**2, -1) == levels.UNSEEN


def test_one_of_four_trends_of_a_right_model_is_reported_by_chance_as_often_as_any_false_alarm() -> None:
    assert 1.0 - (1.0 - 2.0 * norm.sf(levels.TREND)) ** 4 == pytest.approx(levels.ALPHA, rel=0.1)


def test_what_is_too_far_to_be_refitted_is_told_apart_without_doubt() -> None:
    assert norm.sf(levels.FAR) < 1e-11
    assert norm.sf(0.9 * levels.FAR) > 1e-11
    assert levels.REFIT_SCATTER == 2 * 0.5  # the standard deviation of d from refits is a half


# --- the empirical ones, each at its edge


@pytest.mark.parametrize(("ratio", "alike"), [(2.4, True), (2.6, False)])
def test_two_sets_change_places_if_one_leaves_no_more_than_two_and_a_half_times_the_other(
    ratio: float, alike: bool
) -> None:
    def left(rmse: float) -> Any:
        channels = (SimpleNamespace(name="x", own_scale=True, floor=1.0),)
        errors = {"x": SimpleNamespace(rmse=rmse)}
        problem = SimpleNamespace(noise=SimpleNamespace(channels=channels))
        return SimpleNamespace(fit=SimpleNamespace(problem=problem, errors=errors))

    search: Any = SimpleNamespace(in_own_scale=True)
    assert rivals._both_leave(search, left(3.1), left(3.1 * math.sqrt(ratio))) is alike
    assert not rivals._both_leave(search, left(2.9), left(2.9))


@pytest.mark.parametrize(("apart", "alike"), [(1.9, True), (2.1, False)])
def test_unknowns_two_deviations_apart_do_not_differ(apart: float, alike: bool) -> None:
    """Of variances 3 and 2, and a covariance of 0.5: the difference has variance 4."""
    solution = SimpleNamespace(covariance=np.array([[3.0, 0.5], [0.5, 2.0]]))
    shared = [SimpleNamespace(name=name) for name in ("a", "b")]
    fit: Any = SimpleNamespace(
        problem=SimpleNamespace(shared=shared), values=np.array([5.0, 5.0 + 2.0 * apart]), solution=solution
    )
    assert rivals._within_chance(fit, "a", "b") is alike


@pytest.mark.parametrize(
    ("cos", "size", "near"),
    [
        (0.51, 1.0, True),
        (0.49, 1.0, False),
        (0.6, 15.0, True),  # d = 6.7 of at most 6.99
        (0.6, 16.2, False),
        (0.923, 1000.0, True),  # d is 0.196 of the size, of at most 0.2
        (0.917, 1000.0, False),
    ],
)
def test_signatures_are_refitted_if_they_are_alike_and_not_too_far_apart(
    cos: float, size: float, near: bool
) -> None:
    assert Search._near(cos, size) is near


def test_a_gain_of_six_is_worth_a_refit() -> None:
    scores = [SimpleNamespace(gain=gain, candidate=k) for k, gain in enumerate((5.9, 6.1, 90.0))]
    view: Any = SimpleNamespace(
        screening=SimpleNamespace(scores=scores), linearisation=SimpleNamespace(candidates="abc")
    )
    assert Search._next_candidates(view) == ["c", "b"]


@pytest.mark.parametrize(
    ("explained", "share", "slight"),
    [
        (190.0, 0.14, True),
        (190.0, 0.16, False),  # a sixth of what the set explains is no small member
        (210.0, 0.14, False),  # of which less than a tenth may be left and unseen, 20
    ],
)
def test_a_small_member_is_kept_for_ten_times_what_may_go_unseen(
    explained: float, share: float, slight: bool
) -> None:
    search: Any = SimpleNamespace(tolerance=0.0, has_discrepancies=True, excess=lambda _: 0.0)
    with_it, without = (cast("RefittedSet", SimpleNamespace(chi2=chi2)) for chi2 in (0.0, explained))
    assert RefittedSets.slight(search, with_it, without, explained / share) is slight


@pytest.mark.parametrize(
    ("tolerance", "left", "sure"),
    [(0.1, 0.049, True), (0.1, 0.051, False), (0.0, 0.029, True), (0.0, 0.031, False)],
)
def test_the_right_set_leaves_five_percent_and_of_a_table_three(
    tolerance: float, left: float, sure: bool
) -> None:
    search: Any = SimpleNamespace(tolerance=tolerance, left=lambda _: left)
    search.allowed = RefittedSets.allowed.fget(search)  # type: ignore[attr-defined]
    trial: Any = SimpleNamespace(candidates=("alpha",))
    assert RefittedSets.sure(search, trial) is sure


@pytest.mark.parametrize(("explained", "count"), [(44.0**2, 1), (46.0**2, 0)])
def test_a_tenth_of_what_an_effect_explains_may_be_another_shape_of_its_law(
    explained: float, count: int
) -> None:
    """Where that is 4.5 sigmas, the shape may account for what is left, and nothing is said."""
    best: Any = SimpleNamespace(unusual={}, undetermined=(), candidates=("alpha",))
    assert len(reasons_against(best, {}, Remainder(0.01, 9.0, 1e-6, "", "", ""), explained)) == count


@pytest.mark.parametrize(("left", "why"), [(0.17, None), (0.19, "resembles")])
def test_a_formula_that_leaves_a_fifth_only_resembles_the_term(left: float, why: str | None) -> None:
    found: Any = SimpleNamespace(left=left, check=SimpleNamespace(possible=True, passed=True))
    assert FoundFormula.doubt.fget(found) == why  # type: ignore[attr-defined]
