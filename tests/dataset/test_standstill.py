"""A stretch of equal readings is no coincidence where noise changes the others."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.dataset.standstill import StandstillDetector, find_standstill

RNG = np.random.default_rng(7)
TIMES = 5.0 * np.arange(300)


def noisy(step: float = 0.01) -> np.ndarray:
    """A warming sensor with a noise of 0.06 K, in steps of `step`."""
    return np.round((20.0 + 0.02 * TIMES + 0.06 * RNG.standard_normal(300)) / step) * step


def test_a_sensor_that_sticks_is_found_and_placed() -> None:
    values = noisy()
    values[150:185] = values[150]
    found = find_standstill(TIMES, values)
    assert found is not None
    assert (found.readings, found.begin, found.end) == (35, 750.0, 920.0)
    assert found.value == values[150]


@pytest.mark.parametrize("pieces", [1, 7, 150, 160, 299])
def test_it_is_the_same_however_a_file_is_read(pieces: int) -> None:
    values = noisy()
    values[150:185] = values[150]
    values[160:164] = np.nan  # a missing value changes nothing
    detector = StandstillDetector()
    for begin in range(0, 300, pieces):
        detector.add(TIMES[begin : begin + pieces], values[begin : begin + pieces])
    assert detector.found() == find_standstill(TIMES, values)
    found = detector.found()
    assert found is not None
    assert found.readings == 31


@pytest.mark.parametrize("step", [0.01, 0.1, 0.5, 2.0])
def test_a_sound_sensor_repeats_no_value_for_too_long(step: float) -> None:
    assert find_standstill(TIMES, noisy(step)) is None


def test_a_quantity_at_rest_that_an_encoder_counts_says_nothing() -> None:
    position = np.repeat([0.0, 1.0, 2.0, 3.0, 10.0, 0.0], 50)
    assert find_standstill(TIMES, position) is None
    assert find_standstill(TIMES, np.full(300, 22.0)) is None
    assert find_standstill(TIMES[:0], TIMES[:0]) is None
