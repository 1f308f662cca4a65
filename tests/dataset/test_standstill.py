"""A stretch of equal readings is no coincidence where noise changes the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rigctl.dataset.standstill import Standstill, StandstillDetector, find_standstills

TIMES = 5.0 * np.arange(300)
FAST = 0.01 * np.arange(2000)


def rounded(values: np.ndarray, step: float) -> np.ndarray:
    return np.round(values / step) * step


def noisy(step: float = 0.01, slope: float = 0.02, seed: int = 7) -> np.ndarray:
    """A warming sensor with a noise of 0.06 K, in steps of `step`."""
    noise = 0.06 * np.random.default_rng(seed).standard_normal(300)
    return rounded(20.0 + slope * TIMES + noise, step)


def stuck(values: np.ndarray, begin: int, end: int) -> np.ndarray:
    values = values.copy()
    values[begin:end] = values[begin]
    return values


def found_in(*records: np.ndarray, times: np.ndarray = TIMES) -> list[Standstill]:
    return find_standstills((times[: one.size], one) for one in records)


@pytest.mark.parametrize("slope", [0.0, 0.02, 0.04])
@pytest.mark.parametrize("step", [1e-9, 0.01, 0.05])
def test_a_sensor_that_sticks_is_found_and_placed(step: float, slope: float) -> None:
    values = stuck(noisy(step, slope), 150, 185)
    assert found_in(values) == [Standstill(35, 0, 750.0, 920.0, values[150])]


def test_every_stretch_is_found_in_its_record() -> None:
    twice = stuck(stuck(noisy(seed=1, slope=0.0), 20, 60), 200, 250)
    whole = np.full(300, twice[20])  # one that was stuck from the beginning to the end
    found = found_in(noisy(seed=2, slope=0.0), twice, whole)
    assert [(one.record, one.readings, one.begin) for one in found] == [
        (1, 41, 100.0),  # the reading after it happens to be the same
        (1, 50, 1000.0),
        (2, 300, 0.0),
    ]


def test_a_coarse_converter_hides_no_sensor_that_is_stuck_for_long() -> None:
    """Noise of half a step of the converter: readings repeat, but never for so long."""
    noise = 0.12 * np.random.default_rng(3).standard_normal(2000)
    values = rounded(20.0 + noise, 0.25)
    assert not found_in(values, times=FAST)
    (found,) = found_in(stuck(values, 900, 1300), times=FAST)
    assert found.readings == pytest.approx(400, abs=10)


@pytest.mark.parametrize("pieces", [1, 2, 7, 150, 160, 299])
def test_it_is_the_same_however_a_file_is_read(pieces: int) -> None:
    values = stuck(noisy(), 150, 185)
    values[160:164] = np.nan  # a missing value changes nothing
    detector = StandstillDetector()
    detector.begin_record()
    for begin in range(0, 300, pieces):
        detector.add(TIMES[begin : begin + pieces], values[begin : begin + pieces])
    assert detector.found() == found_in(values)
    assert [one.readings for one in detector.found()] == [31]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("step", [0.01, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 2.0])
def test_a_sound_sensor_repeats_no_value_for_too_long(step: float, seed: int) -> None:
    assert not found_in(noisy(step, seed=seed))
    assert not found_in(noisy(step, 0.0, seed))


def _encoder(rng: np.random.Generator) -> np.ndarray:
    """A pendulum that dry friction stops."""
    swing = 3.0 * np.exp(-0.1 * FAST) * np.cos(rng.uniform(1.0, 8.0) * FAST)
    return rounded(np.where(FAST < 10.0, swing, 0.137), 0.001)


def _counter(rng: np.random.Generator) -> np.ndarray:
    """It moves evenly to its end, and back to the middle."""
    speed = rng.uniform(3.0, 6.0)
    return rounded(np.minimum(speed * FAST, 20.0) - np.clip(speed * (FAST - 12.0), 0.0, 9.0), 0.01)


def _flow(rng: np.random.Generator) -> np.ndarray:
    return np.where(FAST % 7.0 < 4.0, 5.0 + 0.1 * rng.standard_normal(2000), 0.0)


def _flow_both_ways(rng: np.random.Generator) -> np.ndarray:
    """A meter that shows zero below its cut-off, forwards and backwards for a second each, with rests."""
    direction = np.array([1.0, 0.0, -1.0, 0.0])[(FAST // 1.0).astype(int) % 4]
    return np.where(direction == 0.0, 0.0, 5.0 * direction + 0.1 * rng.standard_normal(2000))


def _flow_with_an_undershoot(rng: np.random.Generator) -> np.ndarray:
    values = np.where(FAST % 5.0 < 3.0, 5.0 + 0.1 * rng.standard_normal(2000), 0.0)
    values[300] = -0.01
    return values


def _pressure(rng: np.random.Generator) -> np.ndarray:
    """The pump starts after 8 s; the transducer has an offset."""
    return rounded(np.where(FAST > 8.0, 3.0 + 0.02 * rng.standard_normal(2000), 0.0123), 0.01)


def _saturated(rng: np.random.Generator) -> np.ndarray:
    swing = 5.0 + 3.0 * np.sin(rng.uniform(1.0, 8.0) * FAST)
    return rounded(np.minimum(swing + 0.1 * rng.standard_normal(2000), 7.0), 0.01)


def _slow(rng: np.random.Generator) -> np.ndarray:
    """A tank's temperature, averaged over 2 s."""
    average = np.convolve(rng.standard_normal(2199), np.ones(200) / 200.0, "valid")
    return rounded(20.0 + 0.015 * FAST + 0.5 * average, 0.01)


def _held(rng: np.random.Generator) -> np.ndarray:
    """A logger that is faster than the device."""
    return np.repeat(rounded(20.0 + 0.3 * rng.standard_normal(400), 0.01), 5)


def _report_by_exception(rng: np.random.Generator) -> np.ndarray:
    """A historian stores what differs by more than 0.08 from the last stored value."""
    true = 20.0 + 2.0 * np.sin(0.5 * FAST) + 0.05 * rng.standard_normal(2000)
    told = [true[0]]
    for value in true[1:]:
        told.append(value if abs(value - told[-1]) > 0.08 else told[-1])
    return np.array(told)


def _command(rng: np.random.Generator) -> np.ndarray:
    return np.repeat(rng.uniform(0.0, 1.0, 40), rng.multinomial(2000, np.ones(40) / 40.0))


def _middle_of_a_step(rng: np.random.Generator) -> np.ndarray:
    """Small noise shows only where the quantity is between two steps of the converter."""
    return rounded(np.where(FAST < 10.0, 20.005, 20.01) + 0.002 * rng.standard_normal(2000), 0.01)


@pytest.mark.parametrize(
    "channel",
    [
        *(_encoder, _counter, _flow, _pressure, _saturated, _slow, _held),
        *(_report_by_exception, _command, _middle_of_a_step, _flow_both_ways, _flow_with_an_undershoot),
    ],
)
def test_a_sound_channel_that_rests_is_not_stuck(
    channel: Callable[[np.random.Generator], np.ndarray],
) -> None:
    for seed in range(10):
        values = channel(np.random.default_rng(seed))
        assert not found_in(values, times=FAST)
        assert not found_in(values[:1000], values[1000:], times=FAST)


def test_numbers_of_any_size_are_read() -> None:
    """A model that decays to nothing, a file with numbers that no sensor gives."""
    assert not found_in(np.exp(-5.0 * TIMES))
    assert not found_in(1.7e308 * np.cos(TIMES))


def test_too_little_says_nothing() -> None:
    assert not found_in(np.repeat([0.0, 1.0, 2.0, 3.0, 10.0, 0.0], 50))
    assert not found_in(np.full(300, 22.0))
    assert not found_in(TIMES[:0])
    assert not found_in()
