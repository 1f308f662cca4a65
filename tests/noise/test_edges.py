"""Edges that the sampling does not resolve are found; steps of the noise, ramps and slow swings are not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.noise.edges import THRESHOLD, find_edges

SIGMA = 0.1
TIMES = np.arange(300) * 0.01


def edges(values: np.ndarray, times: np.ndarray = TIMES) -> np.ndarray:
    return np.flatnonzero(find_edges(times, values[:, None], np.array([SIGMA]))[:, 0])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), ramp=st.floats(-50.0, 50.0), swing=st.floats(0.0, 20.0))
def test_noise_ramps_and_what_the_sampling_resolves_are_no_edges(
    seed: int, ramp: float, swing: float
) -> None:
    rng = np.random.default_rng(seed)
    slow = swing * np.sin(2 * np.pi * 1.0 * TIMES)  # a hundred samples each period
    # of 300 values of noise one bends as far by chance in fifty
    assert edges(SIGMA * rng.standard_normal(300) + ramp * TIMES + slow).size <= 6


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    place=st.integers(3, 296),
    height=st.floats(2.0 * THRESHOLD * 6**0.5 * SIGMA, 1e3),
)
def test_a_jump_is_an_edge_and_what_is_beside_it_is_not(seed: int, place: int, height: float) -> None:
    values = SIGMA * np.random.default_rng(seed).standard_normal(300)
    values[place:] += height
    found = set(edges(values))
    assert set(range(place - 2, place + 2)) <= found
    assert len(found) <= 10


def test_a_gap_is_no_edge() -> None:
    times = np.where(np.arange(300) < 150, TIMES, TIMES + 10.0)
    values = np.where(np.arange(300) < 150, 0.0, 50.0)
    assert not edges(values, times).size


def test_missing_values_and_short_records_are_taken_as_they_are() -> None:
    values = np.zeros(300)
    values[150:] = 50.0
    values[149] = np.nan
    assert set(edges(values)) <= {150, 151}
    assert not edges(np.array([0.0, 50.0]), np.array([0.0, 0.01])).size


@pytest.mark.parametrize("period", [5, 20, 50])
def test_a_channel_that_bends_everywhere_has_no_edges(period: int) -> None:
    sweep = 1000.0 * SIGMA * np.sin(2 * np.pi * np.arange(300) / period)
    assert not edges(sweep).size
    stepped = np.where(np.arange(300) < 150, 0.0, 50.0)  # beside one whose edges are
    found = find_edges(TIMES, np.column_stack([sweep, stepped]), np.array([SIGMA, SIGMA]))
    assert found.sum(axis=0).tolist() == [0, 4]
