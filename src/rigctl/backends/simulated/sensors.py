"""Simulated sensors: the reading for a true value, with noise, calibration and converter.

A reading is ``value(code(true + noise·z))`` with white noise z ~ N(0, 1): the noisy value is converted to
raw units by the inverse calibration, rounded to one of the converter's codes, limited to its range, and
converted back by the calibration. Without a converter in the rig file it is ``true + noise·z``.
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from rigctl.rig import Channel, Rig

#: a sensor failure: (the sensor, true SI value, standard normal number) -> reading, SI
Failure = Callable[["Sensor", float, float], float]

_BLOCK = 512  # rows of noise drawn at once, since a call of the generator costs more than its numbers
_TABLE_BITS = 16  # a non-linear calibration is tabulated up to this resolution of the converter


class Sensor:
    """One channel of a simulated bench.

    Attributes
    ----------
    convert: the quantisation by the converter: maps an SI value to the nearest possible reading.
    failure: its failure, if any.
    """

    __slots__ = ("_noise", "channel", "convert", "failure")

    def __init__(self, channel: Channel, *, noise: bool = True, quantised: bool = True) -> None:
        self.channel = channel
        self.convert = _converter(channel) if quantised else _unchanged
        self.failure: Failure | None = None
        self._noise = channel.noise_level if noise else 0.0

    def sound(self, true: float, z: float) -> float:
        """Return the reading of the sensor without its failure, SI."""
        return self.convert(true + self._noise * z)

    def read(self, true: float, z: float) -> float:
        """Return the reading, SI; NaN for a missing value. `z` is a standard normal number."""
        failure = self.failure
        if failure is not None:
            return failure(self, true, z)
        return self.convert(true + self._noise * z)


class Sensors:
    """All channels of a rig, in the order of its layout, with one seeded stream of noise.

    The stream depends only on the seed and the number of readings: a failed sensor uses as many random
    numbers as an intact one, so that the readings of the others do not change.
    """

    def __init__(
        self, rig: Rig, generator: np.random.Generator, *, noise: bool = True, quantised: bool = True
    ) -> None:
        self.by_name = {
            name: Sensor(channel, noise=noise, quantised=quantised) for name, channel in rig.channels.items()
        }
        self._sensors = tuple(self.by_name.values())
        self._noise = _rows(generator, len(self._sensors))

    def read(self, true: Sequence[float]) -> tuple[float, ...]:
        """Return one reading of every channel from the true SI values."""
        row = next(self._noise)
        return tuple(
            [sensor.read(value, z) for sensor, value, z in zip(self._sensors, true, row, strict=True)]
        )


def _rows(generator: np.random.Generator, width: int) -> Iterator[list[float]]:
    """Yield standard normal numbers, `width` at a time."""
    while True:
        yield from generator.standard_normal((_BLOCK, width)).tolist()


def _unchanged(value: float) -> float:
    return value


def _converter(channel: Channel) -> Callable[[float], float]:
    """Return the quantisation function of the channel's converter."""
    raw = channel.raw
    if raw is None:
        return _unchanged
    if not any(channel.calibration.coefficients[2:]):
        return _straight(channel)
    if raw.bits <= _TABLE_BITS:
        return _tabulated(channel)
    return lambda value: channel.value_from_raw(raw.quantise(channel.raw_from_value(value)))


def _straight(channel: Channel) -> Callable[[float], float]:
    """Return the quantisation to evenly spaced values, for a linear calibration."""
    raw = channel.converter
    last = (1 << raw.bits) - 1
    first_value = channel.value_from_raw(raw.low)
    step = (channel.value_from_raw(raw.high) - first_value) / last

    def convert(value: float) -> float:
        code = round((value - first_value) / step)
        return first_value + min(max(code, 0), last) * step

    return convert


def _tabulated(channel: Channel) -> Callable[[float], float]:
    """Return the quantisation for a monotonic calibration curve, from a table of midpoints between codes."""
    raw = channel.converter
    codes = range(1 << raw.bits)
    values = [channel.value_from_raw(raw.low + code * raw.step) for code in codes]
    bounds = [channel.value_from_raw(raw.low + (code + 0.5) * raw.step) for code in codes[:-1]]
    if values[0] > values[-1]:
        values.reverse()
        bounds.reverse()
    return lambda value: values[bisect(bounds, value)]
