"""Board time on the bench's clock."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest

from rigctl.backends.arduino.clock_map import ClockMap

ROLL_OVER = 1 << 32


@pytest.mark.parametrize("drift", [-4e-3, -1e-4, 0.0, 3e-5, 4e-3])
def test_the_true_time_lies_within_the_stated_uncertainty_through_roll_overs(drift: float) -> None:
    jitter = random.Random(5)
    clock = ClockMap()
    begin = ROLL_OVER - 100_000_000  # rolls over after 100 s
    mapped: list[float] = []
    for tick in range(2400):
        true = 0.5 * tick
        board_us = (begin + round(true * (1.0 + drift) * 1e6)) % ROLL_OVER
        assert clock.add(true - jitter.uniform(2e-4, 3e-3), board_us, true + jitter.uniform(2e-4, 3e-3))
        later = true + 0.25
        stamp = (begin + round(later * (1.0 + drift) * 1e6)) % ROLL_OVER
        if true > 60.0:
            mapped.append(clock.to_host(stamp))
            assert abs(mapped[-1] - later) <= clock.uncertainty + 1e-4
    assert all(0.49 < b - a < 0.51 for a, b in pairwise(mapped))


def test_a_restarted_board_is_detected() -> None:
    clock = ClockMap()
    for tick in range(20):
        assert clock.add(tick, 50_000_000 + tick * 1_000_000, tick + 0.002)
    assert not clock.add(20.0, 40_000, 20.002)


def test_a_board_clock_that_stood_still_is_not_taken_for_a_restart() -> None:
    """An emulated board whose computer had stalled used to be reported as restarted."""
    clock = ClockMap()
    for tick in range(20):
        assert clock.add(tick, 50_000_000 + tick * 1_000_000, tick + 0.002)
    assert clock.behind == 0.0
    assert not clock.add(23.0, 70_000_000, 23.002)
    assert clock.behind == pytest.approx(3.0, abs=0.01)
    assert not clock.add(24.0, 40_000, 24.002)
    assert clock.behind == 0.0, "this one began at zero"


@pytest.mark.parametrize("begin", [50_000_000, ROLL_OVER - 60_000_000])
def test_a_board_clock_that_makes_up_for_lost_time_is_not_taken_for_a_restart(begin: int) -> None:
    """An emulated board that lags when it is identified, and runs faster later, was reported as restarted."""
    clock = ClockMap()
    for tick in range(20):
        assert clock.add(tick, begin + tick * 1_000_000, tick + 0.002)
    assert not clock.add(20.0, begin + 21_500_000, 20.002)
    assert clock.behind == pytest.approx(-1.5, abs=0.01)
    assert not clock.add(20.4, 300_000, 20.402)
    assert clock.behind == 0.0, "this one began at zero"


def test_out_of_order_time_stamps_are_mapped() -> None:
    clock = ClockMap()
    clock.add(0.0, 1000, 0.0)
    assert clock.to_host(2000) == pytest.approx(0.001)
    assert clock.to_host(1500) == pytest.approx(0.0005)


def test_delayed_exchanges_are_dropped_and_restarts_detected() -> None:
    clock = ClockMap()
    for k in range(20):
        assert clock.add(k * 0.5, round(k * 0.5e6) + 1500, k * 0.5 + 0.003)
    before = clock.to_host(10_000_000)
    assert clock.add(10.0, 9_800_000, 10.003), "0.2 s behind, once"
    assert clock.to_host(10_000_000) == before
    assert clock.add(10.5, 10_501_500, 10.503)
    assert not clock.add(11.0, 20_000, 11.003), "it begins at zero"


def test_a_persistently_different_time_is_a_restart() -> None:
    clock = ClockMap()
    for k in range(20):
        clock.add(k * 0.5, round(k * 0.5e6) + 1500, k * 0.5 + 0.003)
    late = [clock.add(10.0 + k, round((9.8 + k) * 1e6), 10.003 + k) for k in range(3)]
    assert late == [True, True, False]
