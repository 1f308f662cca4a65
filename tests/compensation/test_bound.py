"""The upper bound of an error ratio from randomised pairs: its coverage, and its minimum number of pairs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.compensation.paired_test import upper_bound


@pytest.mark.parametrize("ratio", [0.2, 1.0, 1.5])
def test_the_bound_covers_the_true_ratio_in_95_of_100_cases(ratio: float) -> None:
    rng = np.random.default_rng(7)
    covered = [upper_bound(ratio * rng.laplace(size=8), rng.laplace(size=8)) >= ratio for _ in range(200)]
    assert np.mean(covered) > 0.92  # 0.95 less two standard deviations of 200


def test_a_schedule_without_effect_is_rarely_accepted() -> None:
    rng = np.random.default_rng(8)
    accepted = [upper_bound(rng.normal(size=6), rng.normal(size=6)) < 1.0 for _ in range(200)]
    assert np.mean(accepted) < 0.08


def test_a_finite_bound_needs_five_pairs() -> None:
    better, worse = np.full(5, 0.01), np.linspace(1.0, 1.4, 5)
    assert math.isinf(upper_bound(better[:4], worse[:4]))
    assert upper_bound(better, worse) < 0.1
    assert math.isinf(upper_bound(better, np.zeros(5)))
    assert upper_bound(np.zeros(5), worse) == 0.0


@given(st.integers(0, 1000), st.floats(0.1, 10.0), st.floats(1e-6, 1e6))
def test_the_bound_scales_with_the_errors_and_not_with_their_unit(
    seed: int, factor: float, unit: float
) -> None:
    rng = np.random.default_rng(seed)
    one, other = rng.normal(size=7), rng.normal(size=7)
    bound = upper_bound(one, other)
    assert upper_bound(factor * one, other) == pytest.approx(factor * bound, rel=1e-6)
    assert upper_bound(unit * one, unit * other) == pytest.approx(bound, rel=1e-6)
    assert bound >= np.sqrt(np.square(one).sum() / np.square(other).sum()) * (1.0 - 1e-6)
