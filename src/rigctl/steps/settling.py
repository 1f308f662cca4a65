"""Detects that a noisy reading has settled at a set-point."""

from __future__ import annotations

import math
from collections import deque

from rigctl.errors import RigctlError
from rigctl.plan.behaviour import StepBench
from rigctl.plan.context import Context
from rigctl.plan.value_text import shown_time
from rigctl.steps.readings import reading

#: longest time over which a reading is averaged before it is compared with a tolerance, s
LONGEST = 1.0


def check_settling(context: Context, verb: str, settle: float, timeout: float) -> None:
    """Refuse a step that fails before its reading can have been within the tolerance for `settle` s.

    Raises
    ------
    RigctlError
        `timeout` is not longer than `settle`.
    """
    if timeout <= settle:
        with context.located(verb, "timeout"):
            raise RigctlError(
                "the step fails before the reading can settle",
                value=shown_time(timeout),
                expected=f"more than the settling time, {shown_time(settle)}",
            )


class MovingMean:
    """The mean of the readings of the last `window` s, and of at least the latest reading."""

    def __init__(self, window: float) -> None:
        self._window = window
        self._readings: deque[tuple[float, float]] = deque()
        self._sum = 0.0

    def add(self, time: float, value: float) -> float:
        """Add a reading and return the mean; NaN if there has been no reading for longer than the window.

        A missing reading (NaN), or an infinite one, is left out.
        """
        if math.isfinite(value):
            self._readings.append((time, value))
            self._sum += value
        elif self._readings and self._readings[-1][0] < time - self._window:
            self._readings.clear()
            self._sum = 0.0
        while len(self._readings) > 1 and self._readings[0][0] < time - self._window:
            self._sum -= self._readings.popleft()[1]
        return self._sum / len(self._readings) if self._readings else math.nan


class Settling:
    """Monitors a reading until its mean has been within `target` ± `within` for `settle` s.

    The mean is taken over half the settling time, at most `LONGEST`: noise on single readings neither
    restarts the settling time nor hides a drift.
    """

    def __init__(self, target: float, within: float, settle: float) -> None:
        self.target = target
        self.within = within
        self.settle = settle
        self.mean = math.nan
        self._means = MovingMean(min(LONGEST, 0.5 * settle))
        self._since: float | None = None
        self.lowest = math.inf
        self.highest = -math.inf

    def add(self, time: float, value: float) -> bool:
        """Add a reading; return True once it has settled."""
        mean = self.mean = self._means.add(time, value)
        if math.isnan(mean):
            self._since = None
            return False
        self.lowest, self.highest = min(self.lowest, mean), max(self.highest, mean)
        if abs(mean - self.target) > self.within:
            self._since = None
            return False
        if self._since is None:
            self._since = time
        return time - self._since >= self.settle - 1e-9

    def gave_up(self, bench: StepBench, channel: str, timeout: float) -> str:
        """Return the message for a reading that has not settled within `timeout` s."""

        def shown(value: float) -> str:
            return reading(bench, channel, value)

        tolerance = reading(bench, channel, self.within, difference=True)
        fine = bench.rig.channels[channel].too_fine(self.within)
        return (
            f"{channel} did not settle at {shown(self.target)} ± {tolerance} within {timeout:g} s: "
            f"it was {shown(self.mean)}, lowest {shown(self.lowest)}, highest {shown(self.highest)}"
            + f"; {fine}"
            * bool(fine)
        )
