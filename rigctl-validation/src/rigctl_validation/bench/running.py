# mypy: disable-error-code="no-untyped-call"
"""The separate bench in operation: advanced from switch to switch, and read at any time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigctl_validation.bench import equations
from rigctl_validation.bench.campaign import Campaign
from rigctl_validation.bench.record import (
    FIRST_STEP,
    TOLERANCE,
    BenchFailure,
    Condition,
    Trace,
    initial_state,
    switching_delay,
)
from rigctl_validation.bench.rosenbrock import integrate
from rigctl_validation.bench.sensing import Correlated, true_channels

#: tolerance for a switch to count as due, s
_ROUNDING = 1e-12


@dataclass
class RunningBench:
    """The bench of a campaign with its hidden effects, from the time at which it was switched on.

    `rigctl_validation.bench.record` makes a record of a known schedule; here future commands are unknown, so
    that a procedure can be carried out.

    Parameters
    ----------
    campaign: bench, sensors, switching, noise, and the seed of everything random.
    condition: its operating point when it is switched on.
    """

    campaign: Campaign
    condition: Condition
    time: float = 0.0
    _pending: list[tuple[float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        at = self.condition
        self._state = initial_state(self.campaign.bench, at)
        self._bench = self.campaign.bench.in_floats()
        self._inputs = np.array([0.0, at.setting, at.heater, at.ambient])
        self._scale = np.array(equations.SCALE)
        self._step = FIRST_STEP
        self._command = 0.0
        self._play = float(self._state[equations.X]) + self.campaign.sensors.position_backlash / 2.0
        switches, noise, settings = np.random.SeedSequence(self.campaign.seed, spawn_key=(0,)).spawn(3)
        self._switches = np.random.Generator(np.random.PCG64(switches))
        self._settings = np.random.Generator(np.random.PCG64(settings))
        self._noise = Correlated(np.random.Generator(np.random.PCG64(noise)), self.campaign.noise)

    def advance(self, time: float) -> None:
        """Integrate to `time`, s; the spool moves when its delay has passed.

        Raises
        ------
        BenchFailure
            the step size fell below what can be represented.
        """
        while self._pending and self._pending[0][0] <= time + _ROUNDING:
            when, command = self._pending.pop(0)
            self._integrate(when)
            self._change(0, command)
        self._integrate(time)

    def valve(self, command: float) -> None:
        """Command the directional valve: extend (1), close (0), retract (−1); it switches after its delay."""
        if command == self._command:
            return
        self._command = command
        late = switching_delay(
            self.campaign.switching, float(self._state[equations.T_OIL]), command, self._switches
        )
        when = self.time + max(0.0, late)
        self._pending = sorted([*self._pending, (when, command)], key=lambda switch: switch[0])

    def relief(self, setting: float) -> None:
        """Set the relief valve to `setting`, Pa, within its repeatability."""
        share = self.campaign.scatter.setting * float(self._settings.standard_normal())
        self._change(1, setting * (1.0 + share))

    def heat(self, power: float) -> None:
        """Set the heater power, W."""
        self._change(2, power)

    def read(self) -> dict[str, float]:
        """The present reading of every channel's sensor, SI, with its noise."""
        shown = self._shown()
        return self._noise.added(shown)

    def _shown(self) -> dict[str, float]:
        """Noise-free readings; backlash makes them depend on the history."""
        sensors, half = self.campaign.sensors, self.campaign.sensors.position_backlash / 2.0
        x = float(self._state[equations.X])
        self._play = min(max(self._play, x - half), x + half)
        state = self._state.copy()
        state[equations.X] = self._play
        trace = Trace(np.array([self.time]), np.array([self._command]), state[None, :])
        one = true_channels(trace, sensors._replace(position_backlash=0.0))
        return {name: float(values[0]) for name, values in one.items()}

    def _change(self, index: int, value: float) -> None:
        if self._inputs[index] != value:
            self._inputs[index] = value
            self._step = FIRST_STEP

    def _integrate(self, time: float) -> None:
        if time - self.time <= _ROUNDING:
            return
        self._step = integrate(
            self._state,
            time - self.time,
            self._step,
            self._inputs,
            self._bench,
            self._scale,
            TOLERANCE,
        )
        if self._step < 0.0:
            raise BenchFailure(f"step size underflow at {self.time:g} s")
        self.time = time

    @property
    def state(self) -> NDArray[np.float64]:
        """The present states, see `equations`."""
        return self._state.copy()
