"""Sensor failures: the reading of a channel for each of the ``sensor_…`` faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from rigctl.backends.simulated.sensors import Failure, Sensor
from rigctl.rig import Channel

#: assumed width of the possible range if it is unlimited, in standard deviations of the channel's noise
_NOISES = 1000.0


def stuck() -> Failure:
    """Repeats the first reading after the start of the failure."""
    held: list[float] = []

    def read(sensor: Sensor, true: float, z: float) -> float:
        if not held:
            held.append(sensor.sound(true, z))
        return held[0]

    return read


def open_circuit() -> Failure:
    """Reads the end of the converter's range that lies outside the channel's possible range, where the rig
    file allows a broken wire to be detected in this way; otherwise no value."""

    def read(sensor: Sensor, true: float, z: float) -> float:
        ends = converter_range(sensor.channel)
        return next((end for end in ends if not sensor.channel.possible(end)), math.nan)

    return read


def noisy() -> Failure:
    """Adds white noise whose standard deviation is a tenth of the possible range, or 100 times that of the
    channel's noise if the range is unlimited."""

    def read(sensor: Sensor, true: float, z: float) -> float:
        return sensor.convert(true + 0.1 * _span(sensor.channel) * z)

    return read


def out_of_range() -> Failure:
    """Reads a tenth of the range more than the possible maximum; no value if the range is unlimited."""

    def read(sensor: Sensor, true: float, z: float) -> float:
        high = possible_range(sensor.channel)[1]
        return high + 0.1 * _span(sensor.channel) if math.isfinite(high) else math.nan

    return read


#: kind of fault -> function that makes the failure
SENSOR_FAILURES: Mapping[str, Callable[[], Failure]] = {
    "sensor_stuck": stuck,
    "sensor_open": open_circuit,
    "sensor_noisy": noisy,
    "sensor_out_of_range": out_of_range,
}


def converter_range(channel: Channel) -> tuple[float, float]:
    """Return the SI values of the converter's lowest and highest code; infinite without a converter."""
    raw = channel.raw
    if raw is None:
        return -math.inf, math.inf
    return channel.value_from_raw(raw.low), channel.value_from_raw(raw.high)


def possible_range(channel: Channel) -> tuple[float, float]:
    """Return the physically possible SI range; by default the range of the converter."""
    low, high = channel.range or sorted(converter_range(channel))
    return float(low), float(high)


def _span(channel: Channel) -> float:
    """Return the width of the possible range; if it is unlimited, a width derived from the noise."""
    low, high = possible_range(channel)
    return high - low if math.isfinite(high - low) else _NOISES * (channel.noise_level or 1.0)
