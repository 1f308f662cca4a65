"""No reading within three sigmas of a proposed record trips a limit of the rig."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.design.feasible import CLEARANCE, clear_of_limits
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig

Floats = NDArray[np.float64]

CHANNELS = ("oil_temperature", "supply_pressure", "position")
TIMES = np.arange(0.0, 3.0, 0.05)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(shipped() / "rigs" / "hl32-bench.yaml")


def trips(rig: Rig, readings: Floats) -> list[str]:
    """The limits that readings (n, channels) exceed, however briefly; an independent implementation."""
    found = []
    for name, limit in rig.limits.items():
        course = readings[:, CHANNELS.index(limit.channel)]
        if limit.of_rate:
            steps = round(limit.over / (TIMES[1] - TIMES[0]))
            course = (course[steps:] - course[:-steps]) / (TIMES[steps:] - TIMES[:-steps])
        if np.any(course > limit.threshold if "above" in limit.bound else course < limit.threshold):
            found.append(name)
    return found


@given(
    start=st.floats(-0.002, 0.23),
    speed=st.floats(-0.7, 0.7),
    pressure=st.floats(5e5, 65e5),
    temperature=st.floats(275.0, 370.0),
    spread=st.floats(0.1, 10.0),
    seed=st.integers(0, 10**6),
)
def test_records_clear_of_limits_trip_none_for_any_noise_within_the_clearance(
    rig: Rig, start: float, speed: float, pressure: float, temperature: float, spread: float, seed: int
) -> None:
    course = np.clip(start + speed * np.clip(TIMES - 0.5, 0.0, 1.0), -0.01, 0.26)
    outputs = np.stack([np.full(TIMES.size, temperature), np.full(TIMES.size, pressure), course], axis=1)
    sigma = spread * np.broadcast_to([0.1, 8e3, 1e-4], outputs.shape)
    if not clear_of_limits(rig, CHANNELS, TIMES, outputs, sigma):
        return
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, (20, *outputs.shape)) * sigma
    # a rate is taken between two readings, whose noises add as squares
    root = np.where(
        [any(one.of_rate and one.channel == name for one in rig.limits.values()) for name in CHANNELS],
        np.sqrt(0.5),
        1.0,
    )
    for one in noise:
        assert trips(rig, outputs + CLEARANCE * root * one) == []


def test_limits_of_rates_are_checked_for_slow_sampling_too(rig: Rig) -> None:
    """`oil_rises_too_fast` is taken over 10 s; for readings every 30 s, between two neighbours."""
    times = np.arange(0.0, 300.0, 30.0)
    outputs = np.stack([300.0 + 0.05 * times, np.full(times.size, 3e6), np.full(times.size, 0.1)], axis=1)
    sigma = np.broadcast_to([0.1, 8e3, 1e-4], outputs.shape)
    assert clear_of_limits(rig, CHANNELS, times, outputs, sigma)
    outputs[5:, 0] += 20.0  # 0.7 K/s, 0.5 K/s stop
    assert not clear_of_limits(rig, CHANNELS, times, outputs, sigma)


def test_a_record_close_to_a_limit_is_not_clear(rig: Rig) -> None:
    outputs = np.stack(
        [np.full(TIMES.size, 320.0), np.full(TIMES.size, 3e6), np.full(TIMES.size, 0.1)], axis=1
    )
    sigma = np.broadcast_to([0.1, 8e3, 1e-4], outputs.shape)
    assert clear_of_limits(rig, CHANNELS, TIMES, outputs, sigma)
    near = outputs.copy()
    near[10, 2] = 0.24 - 2.9e-4  # over_travel stops above 240 mm
    assert not clear_of_limits(rig, CHANNELS, TIMES, near, sigma)
    hot = outputs.copy()
    hot[:, 0] = 273.15 + 85.0 - 0.2
    assert not clear_of_limits(rig, CHANNELS, TIMES, hot, sigma)
    fast = outputs.copy()
    fast[:, 2] = np.clip(0.1 + 0.7 * (TIMES - 1.0), 0.1, 0.2)  # moves_too_fast: 0.6 m/s
    assert not clear_of_limits(rig, CHANNELS, TIMES, fast, sigma)
    nothing = outputs.copy()
    nothing[5, 1] = np.nan
    assert not clear_of_limits(rig, CHANNELS, TIMES, nothing, sigma)
