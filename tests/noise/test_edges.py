"""Edges at a switch that the sampling does not resolve are found; slow signals lose no reading."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from rigctl.noise.edges import THRESHOLD, find_edges

SIGMA = 0.1
TIMES = np.arange(300) * 0.01
NONE = np.empty(0)


def edges(values: np.ndarray, *switches: float, times: np.ndarray = TIMES, half: float = 0.0) -> np.ndarray:
    found = find_edges(
        times, values[:, None], np.array([SIGMA]), np.array(switches), np.full(len(switches), half)
    )
    return np.flatnonzero(found[:, 0])


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), ramp=st.floats(-50.0, 50.0), swing=st.floats(0.0, 1e3))
def test_without_a_switch_there_is_no_edge(seed: int, ramp: float, swing: float) -> None:
    rng = np.random.default_rng(seed)
    jump = swing * (TIMES > 1.5)
    assert not edges(SIGMA * rng.standard_normal(300) + ramp * TIMES + jump).size


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    place=st.integers(10, 280),
    height=st.floats(3.0 * THRESHOLD * 6**0.5 * SIGMA, 1e3),
    late=st.integers(0, 2),
)
def test_only_the_samples_of_a_jump_at_a_switch_are_an_edge(
    seed: int, place: int, height: float, late: int
) -> None:
    values = SIGMA * np.random.default_rng(seed).standard_normal(300)
    values[place + late :] += height
    found = set(edges(values, TIMES[place]))
    assert {place + late, place + late + 1} - {place} <= found
    assert found <= set(range(place, place + 8))


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    samples=st.floats(3.0, 40.0),
    order=st.integers(1, 3),
    height=st.floats(1.0, 1e4),
    fraction=st.floats(0.0, 1.0),
)
def test_a_response_resolved_by_the_sampling_is_not_an_edge(
    seed: int, samples: float, order: int, height: float, fraction: float
) -> None:
    """One to three lags in series, of three or more samples each, however far above the noise."""
    fine = 50
    switch = 100 + fraction
    step = (np.arange(300 * fine) >= switch * fine).astype(float)
    slow = step
    for _ in range(order):
        keep = np.exp(-1.0 / (samples * fine))
        slow = lfilter([1.0 - keep], [1.0, -keep], slow)
    values = height * slow[::fine] + SIGMA * np.random.default_rng(seed).standard_normal(300)
    assert not edges(values, 0.01 * switch, half=0.005).size


def test_ringing_is_an_edge_until_it_has_decayed() -> None:
    after = np.maximum(np.arange(300) - 99, 0)
    values = 100.0 * np.where(after > 0, np.exp(-after / 3.0) * np.cos(2.2 * after), 0.0)
    found = edges(values, TIMES[99])
    assert set(range(100, 106)) <= set(found)
    assert found.max() < 125


def test_two_tanks_filled_in_steps_lose_no_reading() -> None:
    """Torricelli by SciPy at 4 s and 10 s a sample, the pump's voltage changed every 40 or 20 samples."""
    for spacing, hold, sigma in ((4.0, 40, 1e-3), (4.0, 25, 2e-3), (4.0, 1, 1e-3), (10.0, 20, 1e-3)):
        rng = np.random.default_rng(1)
        pump = np.repeat(rng.uniform(0.2, 1.0, 400 // hold + 1), hold)[:400]

        def levels(t: float, y: np.ndarray, pump: np.ndarray = pump, spacing: float = spacing) -> list[float]:
            out = 0.03 * np.sqrt(np.maximum(y, 0.0))
            return [0.05 * pump[min(int(t / spacing), 399)] - out[0], out[0] - out[1]]

        times = np.arange(400) * spacing
        values = solve_ivp(levels, (0.0, times[-1]), [0.5, 0.5], t_eval=times, max_step=spacing).y.T
        values = values + sigma * rng.standard_normal(values.shape)
        bends = np.abs(np.diff(values, 2, axis=0)) > THRESHOLD * 6**0.5 * sigma
        assert bends.any()  # a test of curvature alone would exclude readings
        switches = times[1:][np.abs(np.diff(pump)) > 0.0]
        assert not find_edges(times, values, np.full(2, sigma), switches).any()


def test_a_gap_is_not_an_edge() -> None:
    times = np.where(np.arange(300) < 150, TIMES, TIMES + 10.0)
    values = np.where(np.arange(300) < 150, 0.0, 50.0)
    assert not edges(values, times[150], times=times).size


def test_missing_values_and_short_records_are_accepted() -> None:
    values = np.zeros(300)
    values[150:] = 50.0
    values[149] = np.nan
    assert set(edges(values, TIMES[150])) <= {150, 151}
    assert not edges(np.array([0.0, 50.0]), 0.01, times=np.array([0.0, 0.01])).size


def test_the_reading_before_an_exactly_known_switch_is_kept() -> None:
    values = np.where(np.arange(300) < 150, 0.0, 50.0)
    assert edges(values, TIMES[150]).tolist() == [150, 151]
    # if known to half a sample only, the sample before may already show the switch
    assert edges(values, TIMES[150] - 0.005, half=0.006).tolist() == [149, 150, 151]


@pytest.mark.parametrize("period", [5, 20, 50])
def test_a_channel_that_is_curved_everywhere_has_no_edges(period: int) -> None:
    sweep = 1000.0 * SIGMA * np.sin(2 * np.pi * np.arange(300) / period)
    switches = TIMES[5::10]
    assert not edges(sweep, *switches).size
    stepped = np.where(np.arange(300) < 150, 0.0, 50.0)  # beside a channel that has edges
    found = find_edges(TIMES, np.column_stack([sweep, stepped]), np.array([SIGMA, SIGMA]), TIMES[150:151])
    assert found[:, 1].sum() == 2


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    samples=st.integers(3, 80),
    switches=st.integers(1, 20),
    share=st.floats(0.05, 1.0),
)
def test_edges_that_overlap_are_those_of_each_switch_by_itself(
    seed: int, samples: int, switches: int, share: float
) -> None:
    rng = np.random.default_rng(seed)
    quiet = np.zeros(200 * samples)  # so that no channel has a quarter of its samples on edges
    jagged = np.where(rng.random(samples) < share, 100.0 * SIGMA * rng.standard_normal(samples), 0.0)
    values = np.concatenate([jagged, quiet])
    times = 0.01 * np.arange(values.size)
    given = np.sort(rng.uniform(-0.01, 0.01 * samples, switches))
    alone = [set(edges(values, switch, times=times)) for switch in given]
    assert set(edges(values, *given, times=times)) == set().union(*alone)


def test_a_long_record_with_a_jagged_signal_and_a_switch_at_every_sample_has_no_edges() -> None:
    count = 60_000
    values = 1e3 * SIGMA * np.random.default_rng(1).standard_normal(count)
    times = 0.01 * np.arange(count)
    assert not edges(values, *times, times=times).size, "it is so everywhere: that is its signal"
