"""Where a signal turns within a window, a trend of higher order separates it from the noise."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.noise import NoiseRecord, estimate_noise

SIGMA = 1e-4


def swinging(samples_per_radian: float, correlation: float, seed: int) -> list[NoiseRecord]:
    """Ten records of a mass on a spring that oscillates after steps of its force, with noise."""
    rng, records = np.random.default_rng(seed), []
    for condition in range(10):
        t = np.arange(600) / samples_per_radian
        start = rng.uniform(0.005, 0.02)
        signal = start * np.exp(-0.05 * t) * np.cos(t + rng.uniform(0, 6))
        white = rng.standard_normal(t.size)
        noise = np.empty_like(white)
        noise[0] = white[0]
        for k in range(1, t.size):
            noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * white[k]
        values = (signal + SIGMA * noise)[:, None]
        records.append(NoiseRecord(0.01 * np.arange(t.size), values, condition, np.zeros(t.size, np.intp)))
    return records


@pytest.mark.parametrize("correlation", [0.0, 0.6])
@pytest.mark.parametrize("samples_per_radian", [15.0, 30.0])
def test_an_oscillating_signal_is_not_taken_for_noise(samples_per_radian: float, correlation: float) -> None:
    found = estimate_noise(swinging(samples_per_radian, correlation, 1), ["position"]).channels[0]
    assert not found.guessed
    # with coloured noise a little of the signal may pass for noise, which is conservative
    assert 0.9 * SIGMA < found.sigma < (1.3 if correlation else 1.1) * SIGMA


def test_two_readings_of_irregular_sampling_may_be_close_together() -> None:
    """Nearly equal times were rounded to the same one, and divided by zero."""
    rng = np.random.default_rng(3)
    times = np.sort(rng.uniform(0.0, 300.0, 1500))
    values = np.sin(times / 40.0)[:, None] + rng.normal(0.0, 0.02, (1500, 1))
    assert np.diff(times).min() < 0.05 * np.median(np.diff(times))
    noise = estimate_noise([NoiseRecord(times, values, 0, np.zeros(1500, np.intp))], ["x"])
    assert noise.sigma[0] == pytest.approx(0.02, rel=0.1)
