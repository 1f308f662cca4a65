"""Decimation of curves without a visible change."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.report.decimation import changes, thin

VALUES = st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), max_size=400).map(np.array)


@given(VALUES, st.integers(4, 100))
def test_decimation_keeps_extremes_and_ends_and_bounds_the_number_of_points(
    values: np.ndarray, points: int
) -> None:
    values = values.astype(float)
    kept = thin(values, points)
    assert np.all(np.diff(kept) > 0)
    assert len(kept) <= max(1.5 * points + 2, 6)
    if len(values):
        assert kept[0] == 0
        assert kept[-1] == len(values) - 1
    if np.isfinite(values).any():
        assert np.nanmax(values[kept]) == np.nanmax(values)
        assert np.nanmin(values[kept]) == np.nanmin(values)


@given(VALUES)
def test_few_points_are_all_kept(values: np.ndarray) -> None:
    assert thin(values.astype(float), 400).tolist() == list(range(len(values)))


def test_a_spike_of_one_sample_in_a_million_is_seen() -> None:
    values = np.zeros(1_000_000)
    values[654_321] = 1.0
    kept = thin(values, 1000)
    assert 654_321 in kept
    assert len(kept) < 1100


def test_a_gap_remains_a_gap() -> None:
    values = np.sin(np.linspace(0.0, 20.0, 10_000))
    values[5_000:5_003] = np.nan
    assert np.isnan(values[thin(values, 200)]).any()


@given(st.lists(st.sampled_from([-1.0, 0.0, 1.0, float("nan")]), max_size=60).map(np.array))
def test_a_step_line_is_drawn_exactly(values: np.ndarray) -> None:
    values = values.astype(float)
    kept = changes(values)
    if not len(values):
        assert len(kept) == 0
        return
    rebuilt = values[kept][np.searchsorted(kept, np.arange(len(values)), side="right") - 1]
    np.testing.assert_array_equal(rebuilt, values)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_up_to_two_samples_are_all_kept(count: int) -> None:
    assert len(thin(np.zeros(count), 4)) == count
