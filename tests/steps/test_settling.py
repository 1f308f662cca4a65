"""A reading counts as settled only while it is there."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.steps.settling import MovingMean, Settling

PERIOD = 0.1


def settled_at(readings: list[float], settle: float) -> float | None:
    """Time at which readings in a band of 0 ± 1 settle; None if they do not."""
    settling = Settling(0.0, 1.0, settle)
    return next((k * PERIOD for k, value in enumerate(readings) if settling.add(k * PERIOD, value)), None)


def test_a_constant_reading_settles_after_the_settling_time() -> None:
    assert settled_at([0.0] * 100, 2.0) == pytest.approx(2.0)


@pytest.mark.parametrize("gone", [math.nan, math.inf, -math.inf])
def test_a_reading_that_disappears_does_not_settle(gone: float) -> None:
    assert settled_at([0.0] + [gone] * 200, 2.0) is None


@pytest.mark.parametrize("gone", [math.nan, math.inf])
def test_the_settling_time_starts_again_after_a_long_gap_and_continues_over_a_short_one(gone: float) -> None:
    """The mean is over half the settling time of 2 s, at most 1 s."""
    assert settled_at([0.0] * 10 + [gone] * 5 + [0.0] * 40, 2.0) == pytest.approx(2.0)
    assert settled_at([0.0] * 10 + [gone] * 15 + [0.0] * 40, 2.0) == pytest.approx(4.5)


def test_without_a_settling_time_a_missing_reading_has_not_settled() -> None:
    settling = Settling(0.0, 1.0, 0.0)
    assert not settling.add(0.0, math.nan)
    assert settling.add(0.1, 0.0)
    assert not settling.add(0.2, math.nan)


@given(st.lists(st.sampled_from([0.0, 1.0, -2.5, math.nan, math.inf]), min_size=1, max_size=60))
def test_the_mean_is_that_of_the_readings_in_the_window(readings: list[float]) -> None:
    mean, window = MovingMean(0.5), 0.5
    for k, value in enumerate(readings):
        found = mean.add(k * PERIOD, value)
        there = [(j * PERIOD, each) for j, each in enumerate(readings[: k + 1]) if math.isfinite(each)]
        inside = [each for time, each in there if time >= k * PERIOD - window]
        if inside:
            assert found == pytest.approx(sum(inside) / len(inside), abs=1e-9)
        else:
            assert math.isnan(found)
