"""Sensor failures: the reading of a channel for each of the ``sensor_…`` faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from rigctl.backends.simulated.sensors import Failure, Sensor
from rigctl.rig import Channel

#: default range, in standard deviations of the channel's noise
_NOISES = 1000.0


def stuck() -> Failure:
    """Repeats the first value after its start."""
    held: list[float] = []

    def read(sensor: Sensor, true: float, z: float) -> float:
        if not held:
            held.append(sensor.sound(true, z))
        return held[0]

    return read


def open_circuit() -> Failure:
    """Reads the end of the converter's range that is outside the possible range, if the rig file allows a
    broken wire to be detected; otherwise there is no value."""

    def read(sensor: Sensor, true: float, z: float) -> float:
        ends = converter_range(sensor.channel)
        return next((end for end in ends if not sensor.channel.possible(end)), math.nan)

    return read


def noisy() -> Failure:
    """Adds white noise of a tenth of the possible range, or of 100 times its own if that is unknown."""

    def read(sensor: Sensor, true: float, z: float) -> float:
        return sensor.convert(true + 0.1 * _span(sensor.channel) * z)

    return read


def out_of_range() -> Failure:
    """Reads a tenth of the range above the possible maximum; no value if the range is unlimited."""

    def read(sensor: Sensor, true: float, z: float) -> float:
        high = possible_range(sensor.channel)[1]
        return high + 0.1 * _span(sensor.channel) if math.isfinite(high) else math.nan

    return read


#: fault kind -> a new failure
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
    """Return the width of the possible range; derived from the noise without a range and a converter."""
    low, high = possible_range(channel)
    return high - low if math.isfinite(high - low) else _NOISES * (float(channel.noise or 0.0) or 1.0)
