"""The step of a converter is found from the values; its bias and variance agree with simulations."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.noise.converter import find_step, noise_before, stretch_bias, window_share


@pytest.mark.parametrize("sigma", [0.02, 0.2, 0.5, 3.0])
@pytest.mark.parametrize("step", [0.25, 1e-4, 1.2e4])
def test_the_step_of_a_converter_is_found_in_noisy_values(sigma: float, step: float) -> None:
    rng = np.random.default_rng(1)
    series = [
        np.round(rng.uniform(0, 50) + np.linspace(0, 9, 300) + sigma * rng.standard_normal(300)) * step
        + 273.15
        for _ in range(6)
    ]
    assert find_step(series) == pytest.approx(step, rel=1e-6)


def test_the_step_is_found_in_rounded_values_with_a_placeholder() -> None:
    rng = np.random.default_rng(2)
    values = np.round(0.4883 * np.round((40 + 30 * rng.random(800)) / 0.4883), 2)
    values[0] = 23.0
    assert find_step([values]) == pytest.approx(0.4883, rel=2e-3)


def test_values_without_a_grid_have_no_step() -> None:
    rng = np.random.default_rng(3)
    assert find_step([rng.standard_normal(400) for _ in range(3)]) == 0.0
    assert find_step([np.full(100, 3.0)]) == 0.0
    assert find_step([]) == 0.0


@pytest.mark.parametrize("sigma", [0.1, 0.2, 0.35])
def test_the_bias_of_a_stretch_agrees_with_a_simulated_converter(sigma: float) -> None:
    rng = np.random.default_rng(4)
    levels = np.linspace(0.0, 1.0, 100, endpoint=False)
    noise = sigma * rng.standard_normal((20000, 1))
    converted = np.round(levels + noise)
    bias = (converted - noise).mean(axis=0) - levels
    assert stretch_bias(1.0, sigma) == pytest.approx(bias.std(), abs=0.004)
    within = float(np.sqrt(converted.var(axis=0).mean()))
    assert noise_before(1.0, within) == pytest.approx(sigma, abs=0.005)


def test_the_bias_is_that_of_rounding_without_noise_and_vanishes_for_wide_noise() -> None:
    assert stretch_bias(0.3, 0.0) == pytest.approx(0.3 / np.sqrt(12.0), rel=0.03)
    assert stretch_bias(0.3, 0.3) < 1e-8
    assert stretch_bias(0.0, 1.0) == 0.0
    assert stretch_bias(1.0, 0.3) == pytest.approx(
        np.exp(-2 * np.pi**2 * 0.09) / np.pi / np.sqrt(2), rel=1e-3
    )


@pytest.mark.parametrize("level", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("sigma", [0.2, 0.35])
def test_the_variance_at_a_level_agrees_with_a_simulated_converter(level: float, sigma: float) -> None:
    converted = np.round(level + sigma * np.random.default_rng(5).standard_normal(200_000))
    expected = converted.var() / (sigma**2 + 1.0 / 12.0)
    assert window_share(np.array([[14.0 + 2.0 * level]]), 2.0, 2.0 * sigma)[0] == pytest.approx(
        expected, abs=0.015
    )


@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.35, 2.0])
def test_a_signal_that_crosses_steps_has_the_full_quantisation_variance(sigma: float) -> None:
    assert window_share(np.linspace(0.0, 5.0, 500)[None, :], 1.0, sigma)[0] == pytest.approx(1.0, abs=0.02)
