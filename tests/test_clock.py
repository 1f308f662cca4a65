"""Clocks: real, scaled, virtual."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from hypothesis import given
from hypothesis import strategies as st

from rigctl.clock import ScaledClock, VirtualClock, real_clock


class Wall:
    """A wall clock that tests move by hand."""

    def __init__(self) -> None:
        self.time = 100.0
        self.slept: list[float] = []

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.time += seconds


def test_a_virtual_clock_moves_only_during_waits() -> None:
    clock = VirtualClock()
    assert clock.now() == 0.0
    clock.sleep_until(7200.0)
    assert clock.now() == 7200.0
    clock.sleep_until(3.0)
    assert clock.now() == 7200.0
    assert clock.date() == datetime(2000, 1, 1, 2, tzinfo=UTC)


@given(st.lists(st.floats(0, 1e6)))
def test_a_virtual_clock_never_goes_back(waits: list[float]) -> None:
    clock = VirtualClock()
    seen = [clock.now()]
    for wait in waits:
        clock.sleep_until(wait)
        seen.append(clock.now())
    assert seen == sorted(seen)


def test_a_scaled_clock_sleeps_for_the_remaining_wall_time() -> None:
    wall = Wall()
    clock = ScaledClock(speed=10.0, monotonic=wall.now, sleep=wall.sleep)
    assert clock.name == "10x"
    clock.sleep_until(20.0)
    assert wall.slept == [2.0]
    assert clock.now() == 20.0
    clock.sleep_until(5.0)
    assert wall.slept == [2.0]


def test_the_date_advances_at_the_speed_of_the_scaled_clock() -> None:
    wall = Wall()
    started = datetime(2026, 3, 14, tzinfo=UTC)
    clock = ScaledClock(speed=2.0, monotonic=wall.now, sleep=wall.sleep, started=started)
    wall.time += 30.0
    assert clock.date() == started + timedelta(seconds=60.0)


def test_the_real_clock_runs_at_the_speed_of_time() -> None:
    clock = real_clock()
    assert (clock.name, clock.speed) == ("real", 1.0)
    before = clock.now()
    clock.sleep_until(before)
    assert clock.now() >= before >= 0.0
