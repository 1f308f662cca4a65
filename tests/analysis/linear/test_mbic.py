"""The penalty for an effect, and how many independent readings correlated ones are worth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from made_fit import RECORDS, SIZE, made_fit
from rigctl.analysis.linear.mbic import effective_samples, mbic
from rigctl.noise import ChannelNoise, NoiseModel


def test_the_penalty_of_each_parameter_and_of_the_choice_among_effects() -> None:
    choice = math.log(12.0**2)
    assert mbic(10.0, 2, 1, 100.0, 12) == pytest.approx(10.0 + math.log(100.0**2) + choice)
    assert mbic(0.0, 0, 3, 100.0, 12) == pytest.approx(3 * choice)
    assert mbic(0.0, 0, 1, 100.0, 1) == mbic(0.0, 0, 1, 100.0, 2) == pytest.approx(math.log(4.0))
    assert mbic(0.0, 0, 1, 100.0, 3) == pytest.approx(math.log(9.0))


@pytest.mark.parametrize(("correlation", "white"), [(0.0, 0.0), (0.8, 0.0), (0.8, 0.3)])
def test_the_mean_of_correlated_readings_scatters_like_that_of_the_effective_ones(
    correlation: float, white: float
) -> None:
    """var(mean) = σ²/N_eff of a long record; channels that count several readings as one have fewer."""
    noise = ChannelNoise("position", 0.1, correlation, white=white, together=1.0)
    times = np.arange(3000.0)
    worth = 0.1**2 / (noise.covariance(times, 1.0).sum() / times.size)
    fit: Any = made_fit(NoiseModel((noise, ChannelNoise("pressure", 0.1, together=7.0)), 1.0), 1)
    inside = fit.problem.ok[0].copy()
    inside[:50] = False
    fit.problem.ok = (inside, *fit.problem.ok[1:])
    readings = RECORDS * 3 * SIZE - 50
    assert effective_samples(fit) == pytest.approx(readings * (worth + 1.0 / 7.0), rel=2e-3)


def test_each_record_is_worth_a_reading_and_all_are_worth_two() -> None:
    channels = tuple(ChannelNoise(name, 0.1, together=1e6) for name in ("position", "pressure"))
    fit: Any = made_fit(NoiseModel(channels, 1.0), 1)
    assert effective_samples(fit) == RECORDS
    vars(fit)["fitted"] = (3,)
    assert effective_samples(fit) == 2.0
