"""The levels of verdicts that follow from statistics; what is empirical is tested where it acts."""

from __future__ import annotations

import math

import pytest
from scipy.stats import norm

from rigctl.analysis import decision_levels as levels


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
