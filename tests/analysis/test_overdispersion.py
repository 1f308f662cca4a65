"""A misfit beyond the noise reduces the weight of differences; noise alone does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from made_fit import made_fit, made_noise
from rigctl.analysis.agreement.adequacy import Adequacy, Test, error_below, variance_factor
from rigctl.analysis.decision_levels import BELOW_NOISE
from rigctl.analysis.linear.nuisance_projection import _guessed_degrees
from rigctl.noise import NoiseModel, Source


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_pure_noise_is_not_overdispersed(correlation: float) -> None:
    found = [variance_factor(made_fit(made_noise(correlation), seed)) for seed in range(12)]
    assert np.median(found) < 1.3
    assert max(found) < 2.0


def test_overdispersion_increases_with_the_size_and_the_duration_of_a_misfit() -> None:
    """An oscillation with an amplitude of five sigmas has 12.5 times the variance of the noise."""

    def swing(period: float) -> Callable[[int, np.ndarray], np.ndarray]:
        return lambda _, times: 0.5 * np.sin(2.0 * np.pi * times / period)

    slow = variance_factor(made_fit(made_noise(), 1, swing(180.0)))
    quick = variance_factor(made_fit(made_noise(), 1, swing(2.5)))
    assert slow > 20.0 * quick / 7.0
    assert quick == pytest.approx(1.0 + 0.5 * 12.5, rel=0.15)


def guessed(source: Source, first: bool = True) -> NoiseModel:
    """One channel's noise is a guess, the other's is known."""
    noise = made_noise()
    channels = (
        replace(channel, guessed=(place == 0) == first, source=source if (place == 0) == first else "quiet")
        for place, channel in enumerate(noise.channels)
    )
    return replace(noise, channels=tuple(channels))


def misfit(_: int, times: np.ndarray) -> np.ndarray:
    return 0.2 * np.sin(0.1 * times)


@pytest.mark.parametrize(("source", "worth"), [("rig", 8), ("assumed", 2), ("quiet", 4)])
def test_guessed_noise_has_few_degrees_of_freedom(source: Source, worth: int) -> None:
    assert _guessed_degrees(made_fit(guessed(source), 2, misfit)) == worth


def test_guessed_noise_of_a_channel_without_misfit_has_no_influence() -> None:
    assert _guessed_degrees(made_fit(guessed("assumed", first=False), 2, misfit)) == 0


def test_a_rejected_error_below_the_noise_is_adequate_without_agreeing() -> None:
    right: Any = made_fit(made_noise(), 3)
    assert not error_below(right, BELOW_NOISE)
    problem = right.problem
    wide = made_noise(sigma=0.15)
    problem.noise = wide
    problem.sigma = tuple(wide.sigma_at(record.values) for record in problem.records)
    assert error_below(replace(right), BELOW_NOISE)
    rejected = {"plane": Test(99.0, 1e-9, 4)}
    assert not Adequacy(rejected).adequate
    below = Adequacy(rejected, below_noise=True)
    assert below.adequate
    assert not below.agrees
