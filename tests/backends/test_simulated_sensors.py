"""From true values to readings: noise, calibration and converter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.backends.simulated.failures import SENSOR_FAILURES
from rigctl.backends.simulated.sensors import Sensor, Sensors
from rigctl.rig import Calibration, Channel, Raw, Rig


def channel(bits: int, *coefficients: float) -> Channel:
    return Channel(
        unit="bar",
        quantity="pressure",
        raw=Raw(bits=bits, low=0.0, high=1000.0),
        calibration=Calibration(coefficients=coefficients),
    )


def reference(of: Channel, value: float) -> float:
    """The chain as the rig file defines it, step by step."""
    return of.value_from_raw(of.raw.quantise(of.raw_from_value(value)))


@pytest.mark.parametrize(
    "of",
    [
        channel(10, -12.5, 0.12),
        channel(24, 0.0, 1.0),
        channel(12, 300.0, -0.25),
        channel(8, 0.0, 0.1, 2e-5),
        channel(8, 100.0, -0.1, -2e-5),
        channel(20, 0.0, 0.1, 2e-5),
    ],
    ids=["straight", "fine", "falling", "curved", "curved falling", "curved and fine"],
)
@given(fraction=st.floats(-0.5, 1.5))
def test_the_fast_converter_agrees_with_the_reference_implementation(of: Channel, fraction: float) -> None:
    ends = of.value_from_raw(of.raw.low), of.value_from_raw(of.raw.high)
    value = ends[0] + fraction * (ends[1] - ends[0])
    read, expected = Sensor(of).sound(value, 0.0), reference(of, value)
    step = abs(of.value_from_raw(of.raw.low + of.raw.step) - ends[0])
    half_way = abs(abs(read - value) - abs(expected - value)) < 1e-6 * step  # either code is as near
    assert read == pytest.approx(expected, abs=1e-6 * abs(ends[1] - ends[0]) * 2**-8) or half_way


def test_position_is_read_in_steps_of_a_third_of_a_millimetre(rig: Rig) -> None:
    sensor = Sensor(rig.channels["position"])
    readings = {sensor.sound(0.1 + k * 1e-6, 0.0) for k in range(3000)}
    assert len(readings) in (11, 12)
    steps = np.diff(sorted(readings))
    assert steps == pytest.approx(np.full(len(steps), 0.29325513e-3))


def test_a_converter_clips_at_the_ends_of_its_range(rig: Rig) -> None:
    sensor = Sensor(rig.channels["supply_pressure"])
    assert sensor.sound(500e5, 0.0) == pytest.approx((-12.5 + 0.1221896 * 1023) * 1e5)
    assert sensor.sound(-500e5, 0.0) == pytest.approx(-12.5e5)


def test_noise_has_the_size_that_the_rig_file_states_and_is_white(rig: Rig) -> None:
    sensors = Sensors(rig, np.random.default_rng(5), quantised=False)
    true = (313.15, 30e5, 0.1)
    errors = np.array([sensors.read(true) for _ in range(20_000)]) - true
    stated = [float(part.noise or 0.0) for part in rig.channels.values()]
    assert errors.std(axis=0) == pytest.approx(stated, rel=0.03)
    assert np.abs(errors.mean(axis=0) / stated).max() < 0.03
    assert np.abs(np.corrcoef(errors.T) - np.eye(3)).max() < 0.03
    assert abs(np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]) < 0.03


def test_a_channel_without_noise_reads_the_truth(rig: Rig) -> None:
    sensors = Sensors(rig, np.random.default_rng(5), noise=False, quantised=False)
    assert sensors.read((313.15, 30e5, 0.1)) == (313.15, 30e5, 0.1)


def test_without_a_converter_a_reading_is_the_true_value() -> None:
    speed = Channel(unit="rpm", quantity="other")
    assert [Sensor(speed).read(value, 3.0) for value in (-4321.25, 0.0625, 1e6)] == [-4321.25, 0.0625, 1e6]
    assert Sensor(speed.model_copy(update={"noise": 0.5})).read(2.0, 3.0) == 3.5


@pytest.mark.parametrize("kind", sorted(SENSOR_FAILURES))
def test_sensor_failures_also_act_without_a_converter(kind: str) -> None:
    sensor = Sensor(Channel(unit="A", quantity="current", noise="0.01 A"))
    sensor.failure = SENSOR_FAILURES[kind]()
    first, second = sensor.read(1.0, 0.5), sensor.read(2.0, -0.5)
    assert (first == second) if kind == "sensor_stuck" else (math.isnan(first) or abs(first - 1.0) > 0.4)
