"""The same bench read by several devices, each at its own rate, with readings older than it says."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl_validation.bench.campaign import (
    Campaign,
    Measured,
    generator,
    operating_points,
    recorded_channels,
    scattered_trace,
)
from rigctl_validation.bench.sensing import noisy, true_channels

#: Hz; times and ages of devices are multiples of 1 ms
_FINE = 1000.0


@dataclass(frozen=True)
class Device:
    """What reads some channels.

    Attributes
    ----------
    rate: Hz.
    age: how old a reading is at the time that it is given, s.
    phase: time of the first reading of a record, s.
    """

    name: str
    channels: tuple[str, ...]
    rate: float
    age: float
    phase: float = 0.0


def simulate_on_devices(campaign: Campaign, devices: Sequence[Device]) -> list[Measured]:
    """Every record with a row for each reading, in which channels of other devices are NaN.

    Scatter from record to record is that of `simulate_records`; each device's readings have noise of their
    own.
    """
    return [
        _measured(campaign, devices, oil, pressure, generator(campaign.seed, 1 + i))
        for i, (oil, pressure) in enumerate(operating_points(campaign))
    ]


def _measured(
    campaign: Campaign, devices: Sequence[Device], oil: float, pressure: float, rng: np.random.Generator
) -> Measured:
    trace, sensors = scattered_trace(campaign, oil, pressure, rng, _FINE)
    truth = true_channels(trace, sensors)
    names = recorded_channels(campaign)
    read = {
        device: _readings(device, trace.time.size) for device in devices if set(names) & set(device.channels)
    }
    rows = np.unique(np.concatenate(list(read.values())))
    channels = {name: np.full(rows.size, math.nan) for name in names}
    for device, at in read.items():
        taken = np.maximum(at - round(device.age * _FINE), 0)  # the bench is at rest before its record
        for name in _of(device, names):
            channels[name][np.searchsorted(rows, at)] = noisy(name, truth[name][taken], campaign.noise, rng)
    return Measured(trace.time[rows], trace.command[rows], pressure * 1e5, channels)


def _of(device: Device, names: Iterable[str]) -> list[str]:
    return [name for name in names if name in device.channels]


def _readings(device: Device, length: int) -> NDArray[np.int64]:
    """The rows of a fine trace at which a device gives readings."""
    return np.arange(round(device.phase * _FINE), length, round(_FINE / device.rate), dtype=np.int64)
