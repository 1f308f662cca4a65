"""The white floor is measured whatever the bench does, and holds no signal."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.noise import correlation_time, even_pieces, floor_of_residuals, portmanteau, white_floor

COUNT = 800


def swinging(rng: np.random.Generator, *, period: float, noise: float) -> np.ndarray:
    """A decaying oscillation of unit amplitude, sampled `period` times in a cycle, with white noise."""
    t = np.arange(COUNT)
    return np.exp(-t / 500) * np.cos(2 * np.pi * t / period) + noise * rng.standard_normal(COUNT)


@pytest.mark.parametrize("period", [20.0, 40.0, 120.0])
@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_the_floor_of_a_swinging_body_is_its_white_noise(period: float, noise: float) -> None:
    floor = white_floor([swinging(np.random.default_rng(3), period=period, noise=noise)])
    assert floor is not None
    assert floor.measured
    assert floor.sigma == pytest.approx(noise, rel=0.18)


def test_a_signal_as_fast_as_the_sampling_leaves_only_an_upper_bound() -> None:
    floor = white_floor([swinging(np.random.default_rng(3), period=4.0, noise=0.003)])
    assert floor is not None
    assert not floor.measured
    assert floor.sigma > 0.003


def test_slow_noise_is_not_part_of_the_floor() -> None:
    rng = np.random.default_rng(5)
    walk = np.cumsum(rng.standard_normal(COUNT)) * 0.01
    floor = white_floor([walk + 0.1 * rng.standard_normal(COUNT)])
    assert floor is not None
    assert floor.sigma == pytest.approx(0.1, rel=0.12)


@settings(max_examples=40, deadline=None)
@given(
    coefficients=st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=4),
    scale=st.floats(1e-6, 1e6),
    seed=st.integers(0, 2**16),
)
def test_no_polynomial_changes_the_floor_and_units_scale_it(
    coefficients: list[float], scale: float, seed: int
) -> None:
    noise = np.random.default_rng(seed).standard_normal(300)
    signal = np.polyval(coefficients, np.linspace(-1.0, 1.0, 300))
    plain, moved = white_floor([noise]), white_floor([scale * (noise + signal)])
    assert plain is not None
    assert moved is not None
    if plain.order == moved.order:
        assert moved.sigma == pytest.approx(scale * plain.sigma, rel=0.05)
    assert 0.7 * scale < moved.sigma < 1.4 * scale


def test_heavy_tails_count_in_the_floor_of_residuals_and_not_in_that_of_readings() -> None:
    noise = np.random.default_rng(8).standard_t(3, 4000)
    floor, (own, degrees) = white_floor([noise]), floor_of_residuals([noise], 2)
    assert floor is not None
    assert own > 1.2 * floor.sigma
    assert own == pytest.approx(float(np.std(noise)), rel=0.15)
    assert 1000 < degrees < 4000


def test_few_readings_have_no_floor() -> None:
    assert white_floor([np.arange(12.0)]) is None
    assert math.isnan(floor_of_residuals([np.arange(5.0)], 2)[0])


def test_gaps_and_missing_values_divide_a_record_into_pieces() -> None:
    times = np.array([0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0])
    values = np.array([0.0, 1.0, np.nan, 3.0, 4.0, 5.0, 6.0, 7.0])
    assert [piece.tolist() for piece in even_pieces(times, values, 1.0)] == [[0.0, 1.0], [4.0, 5.0, 6.0, 7.0]]


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_correlation_time_is_that_of_a_first_order_autoregression(rho: float) -> None:
    """τ = (1 + ρ)/(1 − ρ), in pieces as in one."""
    rng = np.random.default_rng(11)
    pieces = []
    for _ in range(4):
        values = rng.standard_normal(5000)
        for i in range(1, values.size):
            values[i] += rho * values[i - 1]
        pieces.append(values)
    assert correlation_time(pieces) == pytest.approx((1 + rho) / (1 - rho), rel=0.2)
    assert (portmanteau(pieces) > 0.01) is (rho == 0.0)


def test_the_portmanteau_test_rejects_white_noise_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    p = np.array([portmanteau([rng.standard_normal(400)]) for _ in range(1000)])
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.02)
    assert np.mean(p < 0.5) == pytest.approx(0.5, abs=0.05)
