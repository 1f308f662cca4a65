"""Sensors that fail: what each of the ``sensor_…`` faults makes a channel report."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from rigctl.backends.simulated.sensors import Failure, Sensor
from rigctl.rig import Channel

#: a range that nobody states is taken as this many standard deviations of the channel's noise
_NOISES = 1000.0


def stuck() -> Failure:
    """Holds the first value it reads from now on."""
    held: list[float] = []

    def read(sensor: Sensor, true: float, z: float) -> float:
        if not held:
            held.append(sensor.sound(true, z))
        return held[0]

    return read


def open_circuit() -> Failure:
    """The converter's input is pulled to its end, which lies outside the possible range where the rig file
    lets a broken wire be told from a value; where it does not, there is no value."""

    def read(sensor: Sensor, true: float, z: float) -> float:
        ends = converter_range(sensor.channel)
        return next((end for end in ends if not sensor.channel.possible(end)), math.nan)

    return read


def noisy() -> Failure:
    """Adds white noise of a tenth of the possible range; 100 times its own where that is unknown."""

    def read(sensor: Sensor, true: float, z: float) -> float:
        return sensor.convert(true + 0.1 * _span(sensor.channel) * z)

    return read


def out_of_range() -> Failure:
    """Reports a tenth of the range more than is possible; nothing where anything is possible."""

    def read(sensor: Sensor, true: float, z: float) -> float:
        high = possible_range(sensor.channel)[1]
        return high + 0.1 * _span(sensor.channel) if math.isfinite(high) else math.nan

    return read


#: fault kind -> a fresh failure
SENSOR_FAILURES: Mapping[str, Callable[[], Failure]] = {
    "sensor_stuck": stuck,
    "sensor_open": open_circuit,
    "sensor_noisy": noisy,
    "sensor_out_of_range": out_of_range,
}


def converter_range(channel: Channel) -> tuple[float, float]:
    """The SI values of the converter's lowest and highest code; infinite without one."""
    raw = channel.raw
    if raw is None:
        return -math.inf, math.inf
    return channel.value_from_raw(raw.low), channel.value_from_raw(raw.high)


def possible_range(channel: Channel) -> tuple[float, float]:
    """The physically possible SI values; what the converter can tell where the rig file does not say."""
    low, high = channel.range or sorted(converter_range(channel))
    return float(low), float(high)


def _span(channel: Channel) -> float:
    """The width of the possible range; from the noise where the rig file gives no range and no converter."""
    low, high = possible_range(channel)
    return high - low if math.isfinite(high - low) else _NOISES * (float(channel.noise or 0.0) or 1.0)
