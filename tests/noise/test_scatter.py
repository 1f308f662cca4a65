"""Scatter between replicates: unbiased with many, drawn towards the prior with few, widened with none."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.noise import estimate_scatter
from rigctl.noise.scatter import CAUTION


def test_many_replicates_show_the_scatter_below_the_uncertainty_of_each_value() -> None:
    rng = np.random.default_rng(1)
    conditions = np.repeat(np.arange(400), 2)
    std = np.array([0.0, 1.0, 3.0]) * np.ones((800, 1))
    truth = np.array([2.0, 2.0, 2.0])
    values = rng.standard_normal((400, 3))[conditions] * 50 + rng.standard_normal((800, 3)) * np.hypot(
        truth, std
    )
    found = estimate_scatter(values, std, conditions, prior=np.ones(3))
    assert found.sigma == pytest.approx(truth, rel=0.12)
    assert found.replicates == 400
    assert found.degrees[0] > found.degrees[1] > found.degrees[2]


def test_the_scatter_of_few_replicates_is_drawn_towards_the_prior() -> None:
    rng = np.random.default_rng(2)
    ratios = []
    for _ in range(300):
        values = rng.standard_normal((32, 1)) * 0.5
        conditions = np.concatenate([np.arange(28), np.arange(4)])
        ratios.append(
            float(estimate_scatter(values, np.zeros((32, 1)), conditions, prior=np.ones(1)).sigma[0])
        )
    assert 0.55 < np.mean(ratios) < 0.85
    assert min(ratios) > 0.5


def test_a_scatter_hidden_by_the_uncertainty_of_the_values_stays_at_the_prior() -> None:
    rng = np.random.default_rng(3)
    std, conditions, prior = np.full((8, 1), 10.0), np.arange(8) // 2, np.array([0.1])
    found = [
        estimate_scatter(rng.standard_normal((8, 1)) * 10.0, std, conditions, prior=prior).sigma[0]
        for _ in range(200)
    ]
    assert np.mean(np.abs(np.array(found) - 0.1) < 0.005) > 0.9


def test_without_replicates_the_prior_is_widened_and_the_statement_says_so() -> None:
    found = estimate_scatter(np.zeros((3, 2)), np.ones((3, 2)), np.arange(3), prior=np.array([1.0, 2.0]))
    assert found.sigma == pytest.approx(CAUTION * np.array([1.0, 2.0]))
    assert found.replicates == 0
    assert not found.degrees.any()
    assert "no condition was measured twice" in found.statement


def test_equal_replicates_and_missing_values_are_accepted() -> None:
    values = np.array([[1.0], [1.0], [np.nan], [4.0]])
    found = estimate_scatter(values, np.full((4, 1), 0.01), np.array([0, 0, 1, 1]), prior=np.ones(1))
    assert found.replicates == 1
    assert 0.7 < found.sigma[0] < 0.9


def test_inconsistent_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="shapes"):
        estimate_scatter(np.zeros((3, 2)), np.ones((3, 1)), np.arange(3), prior=np.ones(2))
