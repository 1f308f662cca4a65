"""For how long the computer was suspended, from two of the system's clocks."""

from __future__ import annotations

import pytest

from rigctl import suspension
from rigctl.suspension import suspended_time


class Clocks:
    """The two clocks of a computer, which a test suspends; each reading takes a microsecond."""

    def __init__(self) -> None:
        self.awake = 1000.0
        self.asleep = 0.0
        self.interruptions: list[float] = []

    def read_awake(self) -> float:
        self.awake += 1e-6
        return self.awake

    def read_in_all(self) -> float:
        total = self.awake + self.asleep
        if self.interruptions:  # between this reading and the next
            self.awake += self.interruptions.pop()
        return total


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    made = Clocks()
    monkeypatch.setattr(suspension, "_awake", made.read_awake)
    monkeypatch.setattr(suspension, "_in_all", made.read_in_all)
    return made


def test_a_computer_that_stays_awake_was_not_suspended(clocks: Clocks) -> None:
    assert suspended_time() == pytest.approx(0.0, abs=1e-5)


def test_time_in_sleep_is_suspension(clocks: Clocks) -> None:
    clocks.asleep = 3600.0
    assert suspended_time() == pytest.approx(3600.0, abs=1e-5)


def test_an_interruption_of_this_process_between_the_readings_is_none(clocks: Clocks) -> None:
    clocks.asleep = 60.0
    clocks.interruptions = [5.0, 5.0]
    assert suspended_time() == pytest.approx(60.0, abs=1e-5)


def test_a_process_that_is_always_interrupted_gets_an_answer_that_ends_no_run(clocks: Clocks) -> None:
    clocks.interruptions = [1.0] * 100
    assert suspended_time() == pytest.approx(0.0, abs=1e-5)


def test_the_clocks_of_this_system_can_be_read() -> None:
    first = suspended_time()
    assert first >= 0.0
    assert suspended_time() >= first - 0.1
