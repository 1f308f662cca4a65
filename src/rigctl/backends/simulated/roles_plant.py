"""A simple plant for rigs without a model: each role's channel follows its actuator.

- heat: ``dT/dt = u·R − (T − T_amb)/τ`` with R = 1 K/min and τ = 2 h, u the heater's command;
- set_pressure: ``dp/dt = (p_set − p)/0.2 s``;
- extend, retract: ``dx/dt = ±(range of x)/2.5 s``, stopping at the ends of the range.

All three are integrated exactly over any step. Channels without a role keep their initial value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from rigctl.backends.simulated.failures import possible_range
from rigctl.rig import Rig

HEATING_RATE = 1.0 / 60.0  #: K/s at full heater power
COOLING_TIME = 7200.0  #: s
PRESSURE_TIME = 0.2  #: s
STROKE_TIME = 2.5  #: s for the full range of the position


class RolesPlant:
    """Temperature, pressure and position that follow the actuators of the rig's roles.

    Parameters
    ----------
    rig: its roles, ranges and layout are used.
    initial: SI value of every channel at time 0.
    ambient: K.
    """

    description = "first-order plant from the rig's roles"

    def __init__(self, rig: Rig, initial: Mapping[str, float], ambient: float) -> None:
        self.channels: tuple[str, ...] = rig.layout.channels
        self._values = [initial[name] for name in self.channels]
        self._inputs = dict.fromkeys(rig.actuators, 0.0)
        self._time = 0.0
        self._laws: list[tuple[int, Callable[[float, float], float]]] = []
        roles = rig.roles
        self._driving = {
            role.actuator for role in (roles.heat, roles.set_pressure, roles.extend) if role is not None
        }
        if roles.heat is not None:
            self._add(roles.heat.channel, partial(self._temperature, roles.heat.actuator, ambient))
        if roles.set_pressure is not None:
            self._add(roles.set_pressure.channel, partial(self._pressure, roles.set_pressure.actuator))
        if roles.extend is not None and roles.extend.position is not None:
            low, high = possible_range(rig.channels[roles.extend.position])
            valve = (roles.extend.actuator, float(roles.extend.value))
            self._add(roles.extend.position, partial(self._position, valve, low, high))

    def advance(self, time: float) -> None:
        """Advance the plant to `time`."""
        step = time - self._time
        if step <= 0.0:
            return
        self._time = time
        for index, law in self._laws:
            self._values[index] = law(self._values[index], step)

    def switch(self, actuator: str, value: float) -> None:
        """Set an actuator to an SI value."""
        self._inputs[actuator] = value

    def drives(self, actuator: str) -> bool:
        """Return whether a role names the actuator."""
        return actuator in self._driving

    def take_departures(self) -> Sequence[str]:
        """Return no messages, since there are no effects."""
        return ()

    def read(self) -> list[float]:
        """Return the true SI values."""
        return self._values

    def _add(self, channel: str, law: Callable[[float, float], float]) -> None:
        self._laws.append((self.channels.index(channel), law))

    def _temperature(self, heater: str, ambient: float, value: float, step: float) -> float:
        final = ambient + HEATING_RATE * COOLING_TIME * self._inputs[heater]
        return final + (value - final) * math.exp(-step / COOLING_TIME)

    def _pressure(self, relief: str, value: float, step: float) -> float:
        setting = self._inputs[relief]
        return setting + (value - setting) * math.exp(-step / PRESSURE_TIME)

    def _position(
        self, valve: tuple[str, float], low: float, high: float, value: float, step: float
    ) -> float:
        actuator, extending = valve
        direction = self._inputs[actuator] / extending
        moved = value + direction * (high - low) / STROKE_TIME * step
        return min(max(moved, low), high)
