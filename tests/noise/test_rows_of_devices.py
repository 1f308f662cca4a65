"""Noise of channels that have rows of their own, as those of several devices on one bench have."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.noise import NoiseRecord, estimate_noise, even_pieces

Floats = NDArray[np.float64]
STEP = 0.01


def channel(seed: int, correlation: float, sigma: float, count: int = 600) -> Floats:
    """A course at rest, in motion and at rest, with noise of this correlation from reading to reading."""
    random = np.random.default_rng(seed)
    noise = np.empty(count)
    noise[0] = random.normal(0.0, sigma)
    for k in range(1, count):
        noise[k] = correlation * noise[k - 1] + random.normal(0.0, sigma * np.sqrt(1.0 - correlation**2))
    return noise + np.interp(np.arange(count), [0, 250, 350, count], [0.0, 0.0, 5.0, 5.0])


def records(correlation: float) -> tuple[list[NoiseRecord], list[NoiseRecord]]:
    """The readings of two devices, each in rows of its own, and the same with both in one row."""
    apart, together = [], []
    for k in range(6):
        one, other = channel(2 * k, correlation, 0.1), channel(2 * k + 1, 0.0, 0.3)
        times, phase = STEP * np.arange(one.size), np.repeat([0, 1, 2], 200)
        together.append(NoiseRecord(times, np.column_stack([one, other]), k, phase))
        rows = np.full((2 * one.size, 2), np.nan)
        rows[::2, 0], rows[1::2, 1] = one, other
        every = np.sort(np.concatenate([times, times + 0.4 * STEP]))
        apart.append(NoiseRecord(every, rows, k, np.repeat(phase, 2)))
    return apart, together


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_it_is_that_of_the_same_readings_in_common_rows(correlation: float) -> None:
    apart, together = records(correlation)
    of_rows, of_readings = (estimate_noise(each, ["one", "other"]) for each in (apart, together))
    for one, other in zip(of_rows.channels, of_readings.channels, strict=True):
        assert one.sigma == pytest.approx(other.sigma, rel=1e-9)
        assert one.source == other.source
        assert one.floor == pytest.approx(other.floor, rel=1e-9)
        after = one.correlation ** (of_readings.spacing / of_rows.spacing)
        assert after == pytest.approx(other.correlation, abs=1e-9)


def test_a_reading_lost_in_a_common_row_still_ends_a_stretch() -> None:
    values = np.arange(10.0)
    values[4] = np.nan
    pieces = list(even_pieces(np.arange(10.0), values, 1.0))
    assert [piece.tolist() for piece in pieces] == [[0.0, 1.0, 2.0, 3.0], [5.0, 6.0, 7.0, 8.0, 9.0]]


@given(st.integers(2, 5), st.integers(0, 4), st.sets(st.integers(0, 59), max_size=5))
def test_stretches_are_those_of_the_channels_own_rows(devices: int, place: int, lost: set[int]) -> None:
    """One of several devices that take turns: its stretches, with or without the others' rows."""
    readings = np.arange(60.0)
    readings[list(lost)] = np.nan
    own = list(even_pieces(np.arange(60.0), readings, 1.0))
    rows = np.full(60 * devices, np.nan)
    rows[place % devices :: devices] = readings
    among = list(even_pieces(np.arange(60.0 * devices), rows, 1.0))
    assert [piece.tolist() for piece in among] == [piece.tolist() for piece in own]
