"""A move to a position: stops early enough to coast to the target, and corrects with short timed pulses.

The valve can only be open or closed, so that the position is controlled by when it is closed. Far from
the target the rod moves at full speed and the stop is predicted from the speed just measured; near it,
pulses are given whose length is that of the way plus the dead time that the last pulse has shown. In
between the rod comes to rest and the position is averaged, since what counts is where it stays.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator
from typing import Protocol

from rigctl.plan.behaviour import Behaviour, OnPause, Row, StepBench, Until, Waiting, every_sample
from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.steps.readings import reading
from rigctl.steps.settling import MovingMean

#: lowest sampling rate of the position, Hz, also outside records, if the bench allows it
_RATE = 100.0
#: time over which the position at rest is averaged after each drive, s
_REST = 0.3
#: time of motion over which the speed is determined, s
_SPAN = 0.1
#: assumed time at full speed for which the cylinder coasts after the actuator is switched off, s
_COASTING = 0.03
#: shortest pulse, s; in a shorter one the valve would not open
_SHORTEST = 0.01
#: remaining travel, in s at full speed, below which timed pulses are used
_NEAR = 0.5


class MoveTo(Protocol):
    """The fields of `rigctl.steps.move.Move` that a move to a position needs; SI."""

    @property
    def direction(self) -> int:
        """+1 outwards, −1 inwards, when `actuator` is commanded to `value`."""
        ...

    @property
    def actuator(self) -> str:
        """The commanded actuator."""
        ...

    @property
    def value(self) -> float:
        """The commanded value."""
        ...

    @property
    def position(self) -> str | None:
        """The channel that measures the position."""
        ...

    @property
    def target(self) -> float | None:
        """The target position, m."""
        ...

    @property
    def within(self) -> float | None:
        """The half width of the tolerance, m."""
        ...

    @property
    def timeout(self) -> float | None:
        """Time-out, s."""
        ...


def approach(action: MoveTo, bench: StepBench) -> Behaviour:
    """Bring the position to rest within `within` of `target`, from either side.

    Far from the target it moves at full speed, with a predicted stop. Near the target it uses timed pulses,
    whose length is corrected according to the effect of the previous one.

    Raises
    ------
    StepFailed
        the position is not at rest there within `timeout` s, or it has to be reversed and the rig has no role
        for that.
    """
    drive = _Drive(action, bench)
    try:
        # Undone in `finally`, as is the command.
        bench.need_rate(min(_RATE, bench.rig.fastest))
        position = yield from drive.rest()
        while abs(drive.target - position) > drive.within:
            yield from drive.towards(position)
            position = yield from drive.rest()
    finally:
        drive.stop()
        bench.need_rate(0.0)
    return Outcome.COMPLETE


class _Drive:
    """The actuator, and what has been measured of the response of the position to it."""

    def __init__(self, action: MoveTo, bench: StepBench) -> None:
        if action.position is None or action.target is None or action.within is None:
            raise ValueError("a move to a position needs a channel, a target and a tolerance")
        self.target = action.target
        self.within = action.within
        self._action = action
        self._bench = bench
        self._channel = action.position
        self._column = bench.columns[action.position]
        self._give_up = bench.now + (action.timeout or 0.0)
        self._position = math.nan
        self._speed = math.nan  # m/s at full speed, once measured
        self._lost = 0.0  # dead time of a pulse, in which nothing moves, s

    def rest(self) -> Generator[Until, Row | None, float]:
        """Wait for a short time, and return the mean position, m."""
        mean = MovingMean(_REST)
        end = self._bench.now + _REST
        while self._bench.now < end or math.isnan(self._position):
            row = yield Until(min(self._give_up, max(end, self._bench.now + _SHORTEST)), every_sample)
            if row is not None:
                self._position = mean.add(row[0], row[self._column])
            self._check_time()
        return self._position

    def towards(self, position: float) -> Waiting:
        """Move once in the direction of the target."""
        direction = math.copysign(1.0, self.target - position)
        distance = abs(self.target - position)
        value = self._value(direction)
        if distance < self._speed * _NEAR:
            yield from self._pulse(value, distance)
        else:
            yield from self._full_speed(value, direction)

    def stop(self) -> None:
        """Return the actuator to its safe value."""
        self._bench.release(self._action.actuator)

    def _pulse(self, value: float, distance: float) -> Waiting:
        """Give a pulse to travel `distance`; its effect gives the dead time for the next one."""
        duration = max(distance / self._speed + self._lost, _SHORTEST)
        before = self._position
        receipt = yield from self._bench.command(self._action.actuator, value, duration)
        yield Until(receipt.time + duration, on_pause=OnPause.DEFER)
        yield from self._bench.finish_pulse(self._action.actuator)
        # Whatever of the pulse did not become way is dead time; it may also be negative, if the rod coasts.
        after = yield from self.rest()
        self._lost = duration - abs(after - before) / self._speed

    def _full_speed(self, value: float, direction: float) -> Waiting:
        """Move at full speed; stop at the predicted time, once the next sample would be too late for that."""
        yield from self._bench.command(self._action.actuator, value)
        period = 1.0 / self._bench.rate_of(self._channel)
        past: deque[tuple[float, float]] = deque(maxlen=max(2, round(_SPAN / period) + 1))
        while True:
            row = yield Until(self._give_up, every_sample)
            self._check_time()
            if row is None or math.isnan(row[self._column]):
                continue
            row = self._bench.read_with(row, self._channel)
            if past and row[0] <= past[-1][0]:  # that of another device: no new position
                continue
            self._position = row[self._column]
            past.append((row[0], self._position))
            # Measured in the direction of motion: negative means past the target.
            left = direction * (self.target - self._position)
            if left <= 0.0:
                break
            then, old = past[0]
            span = row[0] - then
            speed = direction * (self._position - old) / span if span > 0.0 else 0.0
            if speed <= 0.0:
                continue
            self._speed = speed
            remaining = left / speed - _COASTING
            # The next sample would come too late: the rest is a wait for a time, not for a reading.
            if remaining < 1.5 * period:
                yield Until(row[0] + remaining, on_pause=OnPause.DEFER)
                break
        self.stop()

    def _value(self, direction: float) -> float:
        """Return the command to the actuator, SI, for a motion outwards (+1) or inwards (−1)."""
        if direction == self._action.direction:
            return self._action.value
        roles = self._bench.rig.roles
        back = roles.retract if direction < 0 else roles.extend
        if back is None or back.actuator != self._action.actuator:
            raise StepFailed("the position lies beyond the target and the rig has no role to go back")
        return float(back.value)

    def _check_time(self) -> None:
        if self._bench.now < self._give_up:
            return
        name = str(self._action.position)
        tolerance = reading(self._bench, name, self.within, difference=True)
        raise StepFailed(
            f"{name} did not come to rest at {reading(self._bench, name, self.target)} ± {tolerance} within "
            f"{self._action.timeout or 0.0:g} s; it was {reading(self._bench, name, self._position)}",
            outcome=Outcome.TIMED_OUT,
        )
