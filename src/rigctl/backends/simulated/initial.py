"""The initial state of the simulated bench."""

from __future__ import annotations

from rigctl.backends.simulated.failures import possible_range
from rigctl.rig import Rig


def initial_values(rig: Rig) -> dict[str, float]:
    """Return the SI value of every channel: from the rig file's ``simulation``; by default ambient for a
    temperature, and otherwise zero or the nearest end of the possible range."""
    given = rig.simulation.initial
    return {name: float(given[name]) if name in given else _resting_value(rig, name) for name in rig.channels}


def initial_commands(rig: Rig) -> dict[str, float]:
    """Return the SI value of every actuator: the safe state; hand-operated ones match the pressure that they
    set."""
    values = initial_values(rig)
    role = rig.roles.set_pressure
    commands: dict[str, float] = {}
    for name, actuator in rig.actuators.items():
        if name in rig.safe_state:
            commands[name] = float(rig.safe_state[name])
        elif role is not None and role.actuator == name:
            commands[name] = _clipped(values[role.channel], actuator.low, actuator.high)
        else:
            commands[name] = _clipped(0.0, actuator.low, actuator.high)
    return commands


def _resting_value(rig: Rig, name: str) -> float:
    channel = rig.channels[name]
    if channel.quantity == "temperature":
        return 0.0 if channel.difference else rig.simulation.ambient_temperature
    return _clipped(0.0, *possible_range(channel))


def _clipped(value: float, low: float | None, high: float | None) -> float:
    if low is not None and value < low:
        return float(low)
    if high is not None and value > high:
        return float(high)
    return value
