"""Board time on the bench's clock."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest

from rigctl.backends.serial.clock_map import ClockMap

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


def test_a_board_that_began_anew_is_noticed() -> None:
    clock = ClockMap()
    for tick in range(20):
        assert clock.add(tick, 50_000_000 + tick * 1_000_000, tick + 0.002)
    assert not clock.add(20.0, 40_000, 20.002)


def test_stamps_out_of_order_are_taken_as_they_are() -> None:
    clock = ClockMap()
    clock.add(0.0, 1000, 0.0)
    assert clock.to_host(2000) == pytest.approx(0.001)
    assert clock.to_host(1500) == pytest.approx(0.0005)
