"""Clocks passed as arguments: real, scaled or virtual time.

All code that waits uses the clock that it was given, so that two hours of heating take milliseconds on a
virtual clock, and identical seeds give identical files.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Protocol

from rigctl.suspension import suspended_time


class Clock(Protocol):
    """Seconds since the run began, and a way to wait."""

    name: str
    speed: float  #: seconds of bench time per second of wall time; infinite for a virtual clock

    def now(self) -> float:
        """Bench time in seconds since the clock was started; never goes back."""
        ...

    def sleep_until(self, when: float) -> None:
        """Return at bench time `when`, or immediately if it has passed."""
        ...

    def date(self) -> datetime:
        """The calendar time (UTC) at `now()`."""
        ...

    def suspended(self) -> float:
        """For how long this computer has been suspended so far, s, whether or not `now` counts that."""
        ...


@dataclass
class ScaledClock:
    """Wall time, run `speed` times as fast; `speed` 1 is real time.

    Monotonic: a step of the computer's calendar clock moves neither `now` nor a wait.
    """

    speed: float = 1.0
    monotonic: Callable[[], float] = time.perf_counter
    sleep: Callable[[float], None] = time.sleep
    suspension: Callable[[], float] = suspended_time
    started: datetime = field(default_factory=lambda: datetime.now(UTC))

    def __post_init__(self) -> None:
        self.name = "real" if self.speed == 1.0 else f"{self.speed:g}x"
        self._origin = self.monotonic()

    def now(self) -> float:
        """Seconds of bench time since the clock was created."""
        return (self.monotonic() - self._origin) * self.speed

    def sleep_until(self, when: float) -> None:
        """Sleep for the wall time that is left until bench time `when`."""
        remaining = (when - self.now()) / self.speed
        if remaining > 0.0:
            self.sleep(remaining)

    def date(self) -> datetime:
        """Start date plus elapsed bench time."""
        return self.started + timedelta(seconds=self.now())

    def suspended(self) -> float:
        """Seconds for which this computer has been suspended; on Windows `now` counts them too."""
        return self.suspension()


@dataclass
class VirtualClock:
    """Simulated time that advances only during waits: as fast as the plant is computed, and deterministic."""

    started: datetime = datetime(2000, 1, 1, tzinfo=UTC)
    name: str = "virtual"
    speed: float = math.inf
    _now: float = 0.0

    def now(self) -> float:
        """Sum of the waits so far, in seconds."""
        return self._now

    def sleep_until(self, when: float) -> None:
        """Advance the time to `when`, without delay."""
        self._now = max(self._now, when)

    def date(self) -> datetime:
        """Start date plus elapsed bench time."""
        return self.started + timedelta(seconds=self._now)

    def suspended(self) -> float:
        """Zero: virtual time stands still with the computer."""
        return 0.0


def real_clock() -> ScaledClock:
    """The clock of a real bench."""
    return ScaledClock(speed=1.0)
