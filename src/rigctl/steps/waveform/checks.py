"""Checks of a complete waveform against the limits of the rig, before anything moves.

In: the commands of a waveform as they will be sent. Out: its lowest and highest value, or a refusal that
says at which second which limit would be violated. The commands are checked, and not the parameters of a
shape: formulas and tables from files are then treated alike, and what has been checked is what will be
sent.

Limits on the rate of change of the pressure that the actuator sets are followed too: a waveform within
all ranges may still trip one, and would end the run in the middle.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final

from rigctl.errors import RigctlError
from rigctl.plan.setpoints import check_level, check_set_point
from rigctl.rig import Actuator, Limit, Rig
from rigctl.steps.waveform.shapes import Shape, highest_frequency
from rigctl.units import show

#: largest number of commands of one waveform; more are probably a typing error
MOST: Final = 1_000_000
#: shortest interval between two commands that a host can maintain, s
SHORTEST: Final = 1e-3
#: relative tolerance within which two rates count as equal
_SLACK: Final = 1e-6


def check_commands(
    rig: Rig, actuator: str, commands: Iterable[tuple[float, float]], *, held: bool
) -> tuple[float, float]:
    """Refuse a waveform that leaves a range, is faster than the rig allows, or switches too often.

    Parameters
    ----------
    commands: times in s and SI values, as they will be sent.
    held: whether the output jumps at each command instead of following a curve.

    Returns
    -------
    The lowest and the highest value.

    Raises
    ------
    RigctlError
        the waveform violates a limit; the message gives the limit, and the time of the violation.
    """
    described = rig.actuators[actuator]
    low, high = math.inf, -math.inf
    newest: tuple[float, float] | None = None
    changed = -math.inf  # time of the latest change, s
    windows = [_Window(rig, name, limit) for name, limit in _rate_limits(rig, actuator)]
    # One pass over all commands, in the order in which a limit would notice them.
    for time, value in commands:
        try:
            check_level(rig, actuator, value)
        except RigctlError as error:
            error.what = f"{error.what}, at {time:g} s of the waveform"
            raise
        low, high = min(low, value), max(high, value)
        if newest is not None and value != newest[1]:
            _check_rate(described, actuator, newest, (time, value), held=held)
            shortest = max(described.min_interval, SHORTEST if held else 0.0)
            if time - changed < shortest * (1.0 - _SLACK):
                raise RigctlError(
                    f"the waveform commands '{actuator}' too often, at {time:g} s",
                    value=f"after {time - changed:g} s",
                    expected=f"at least {shortest:g} s between two changes",
                )
            changed = time
        elif newest is None:
            changed = time
        for window in windows:
            window.add(time, value)
        newest = (time, value)
    role = rig.roles.set_pressure
    if role is not None and role.actuator == actuator:
        for value in (low, high):
            check_set_point(rig, role.channel, value)
    return low, high


def check_frequency(described: Actuator, shape: Shape, period: float, kind: str) -> None:
    """Refuse a sine or a multisine with a frequency that its commands, one every `period` s, cannot follow.

    Raises
    ------
    RigctlError
        fewer than two commands would be given in a period of the highest frequency, or the actuator accepts
        no more.
    """
    highest = highest_frequency(shape)
    if highest * described.min_interval >= 0.5:
        raise RigctlError(
            f"the actuator cannot follow a {kind} of this frequency: it takes a command every "
            f"{described.min_interval:g} s at most",
            value=f"{highest:g} Hz",
            expected=f"below {0.5 / described.min_interval:g} Hz",
        )
    if highest * period >= 0.5:
        raise RigctlError(
            f"too few commands for a {kind} of this frequency",
            value=f"{1.0 / period:g} Hz",
            expected=f"a 'rate' above {2.0 * highest:g} Hz",
        )


def check_sampled(shape: Shape, rate: float) -> None:
    """Refuse a multisine whose highest line the record around it, sampled at `rate` Hz, would not show.

    Raises
    ------
    RigctlError
        the record has less than two samples in a period of the highest line.
    """
    highest = highest_frequency(shape)
    if rate <= 2.0 * highest:
        raise RigctlError(
            f"the record around the multisine is sampled too slowly for its highest line of {highest:g} Hz",
            value=f"{rate:g} Hz",
            expected=f"a record with a 'rate' above {2.0 * highest:g} Hz",
        )


def _check_rate(
    described: Actuator, name: str, before: tuple[float, float], after: tuple[float, float], *, held: bool
) -> None:
    """Check the rate of change between two commands; an output that is `held` in between jumps."""
    if described.max_rate is None:
        return
    span = 0.0 if held else after[0] - before[0]
    rate = abs(after[1] - before[1]) / span if span > 0.0 else math.inf
    if rate > described.max_rate * (1.0 + _SLACK):
        how = f"in {span:g} s" if span else "at once"
        raise RigctlError(
            f"the waveform is faster than '{name}' may be, at {after[0]:g} s",
            value=f"from {described.show(before[1])} to {described.show(after[1])} {how}",
            expected=f"at most {show(described.max_rate, f'{described.display_unit}/s', difference=True)}",
        )


def _rate_limits(rig: Rig, actuator: str) -> Iterator[tuple[str, Limit]]:
    """Yield the rate limits with the action stop on the channel that follows an actuator's level."""
    role = rig.roles.set_pressure
    if role is None or role.actuator != actuator:
        return
    for name, limit in rig.limits.items():
        if limit.channel == role.channel and limit.of_rate and limit.action == "stop":
            yield name, limit


class _Window:
    """The change of a set-point over the time window of a rate limit on its channel."""

    def __init__(self, rig: Rig, name: str, limit: Limit) -> None:
        self._rig, self._name, self._limit = rig, name, limit
        self._past: list[tuple[float, float]] = []
        self._first = 0

    def add(self, time: float, value: float) -> None:
        """Add the next command."""
        over, past = self._limit.over, self._past
        past.append((time, value))
        while self._first + 1 < len(past) and past[self._first + 1][0] <= time - over:
            self._first += 1
        rate = (value - past[self._first][1]) / over
        bound = self._limit.threshold
        passed = rate > bound if self._limit.bound == "rate_above" else rate < bound
        if passed and abs(rate - bound) > _SLACK * abs(bound):
            unit = f"{self._rig.channels[self._limit.channel].unit}/s"
            raise RigctlError(
                f"the waveform would trip the limit '{self._name}' of '{self._limit.channel}', at {time:g} s",
                value=show(rate, unit, difference=True),
                expected=f"{show(bound, unit, difference=True)} over {over:g} s",
            )
