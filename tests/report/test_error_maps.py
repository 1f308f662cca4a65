"""Error maps: only deviations larger than the noise explains are marked."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from made_fit import RECORDS, made_fit, made_noise
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.model.fit.fit import FitResult
from rigctl.report.analysis.maps import channel_maps


def marked(fit: FitResult) -> list[int]:
    """How many conditions are marked, channel by channel."""
    channels = fit.problem.measurements.outputs
    maps = channel_maps(cast("ModelComparison", SimpleNamespace(fit=fit)), "map", channels=channels)
    return [sum(any(row) for row in one.strong) for one in maps]


def test_autocorrelated_noise_is_not_marked() -> None:
    for seed in range(10):
        assert marked(made_fit(made_noise(0.9), seed)) == [0, 0, 0, 0]


def test_a_missing_effect_is_marked_on_its_channel_only() -> None:
    assert marked(made_fit(made_noise(0.9), 1, lambda place, times: 0.1 * (times % 7.0))) == [
        RECORDS,
        RECORDS,
        0,
        0,
    ]
