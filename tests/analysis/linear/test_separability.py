"""The separation of two effects, d = λ·√((1 − cos)/2)."""

from __future__ import annotations

import math

import pytest

from rigctl.analysis.linear.separability import separation


def test_effects_with_equal_signatures_have_zero_separation() -> None:
    assert separation(30.0, 1.0) == 0.0


def test_the_separation_of_orthogonal_effects_is_their_size_over_root_two() -> None:
    assert separation(10.0, 0.0) == pytest.approx(10.0 / math.sqrt(2.0))


def test_the_right_effect_wins_with_the_predicted_probability() -> None:
    """Two unit signatures at a cosine, the first with size λ in unit noise: it wins with Φ(d)."""
    import numpy as np
    from scipy.stats import norm

    size, cos = 4.0, 0.6
    rng = np.random.default_rng(0)
    first, second = np.array([1.0, 0.0]), np.array([cos, math.sqrt(1.0 - cos**2)])
    draws = size * first + rng.standard_normal((40_000, 2))
    wins = float((draws @ first > draws @ second).mean())
    assert wins == pytest.approx(norm.cdf(separation(size, cos)), abs=0.006)
