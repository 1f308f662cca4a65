"""The heat balance of each heater."""

from __future__ import annotations

from rigctl.engine.symbols import Scalar
from rigctl.physics.family import Formula
from rigctl.physics.scope import Scope

HEATERS = (1, 2)


def ambient(m: Scope) -> Scalar:
    """The room's temperature."""
    return m.ambient_temperature + m.total("ambient")


def heater_power(number: int) -> Formula:
    """``P = alpha * Q``: the power is proportional to the command."""

    def power(m: Scope) -> Scalar:
        command = m[f"heater_{number}"]
        linear = m[f"heater_gain_{number}"] * command * m.factor("heater_gain", command=command)
        return linear + m.total(f"heater_power_{number}")

    return power


def convection(number: int) -> Formula:
    """``U * (T - Ta)``, from the heater to the room."""

    def loss(m: Scope) -> Scalar:
        difference = m[f"temperature_{number}"] - m.room_temperature
        return m.convection * difference * m.factor("convection", difference=difference)

    return loss


def temperature_rate(number: int) -> Formula:
    """The sum of the heat flows divided by the heat capacity, in K/s."""

    def rate(m: Scope) -> Scalar:
        balance = m[f"heat_of_heater_{number}"] - m[f"heat_to_room_{number}"] + m.total(f"heat_{number}")
        return balance / m.heat_capacity

    return rate


def reading(number: int) -> Formula:
    """A thermometer's reading: the temperature of its heater plus the terms of effects."""
    return lambda m: m[f"temperature_{number}"] + m.total(f"temperature_{number}_reading")
