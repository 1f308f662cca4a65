"""The range in which thresholds of an input are searched."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.analysis.linear.candidates import data_ranges
from rigctl.effects.registry import library
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.physics.user import parse_family

OVEN = """
family: oven
states:
  body: {start: 20 degC, scale: 10 mK, rate: (bath - body)/lag + load*heating}
inputs:
  bath: {value: 20 degC}
  load: {value: 0 N}
parameters:
  lag: {value: 200 s, bounds: [1 s, 10000 s]}
  heating: {value: 1e-3 K/(N*s), bounds: [0 K/(N*s), 1 K/(N*s)]}
outputs:
  body: {unit: degC, formula: body}
"""


def measured() -> Measurements:
    """A bath held at 300 K and stepped to 330 K, and a load that was measured from -20 N to 50 N."""
    times = np.arange(0.0, 100.0)
    record = MeasuredRecord(
        run="run",
        index=0,
        label="run/0",
        times=times,
        switch_times=np.array([0.0, 50.0]),
        switch_half=np.zeros(2),
        inputs=np.array([[300.0, 10.0], [330.0, 10.0]]),
        values=np.linspace(300.0, 320.0, 100)[:, None],
        condition={},
        group=0,
        phase=np.zeros(100, dtype=np.intp),
        phases=("hold",),
        along=(1,),
        knots=times,
        lines=np.linspace(-20.0, 50.0, 100)[:, None],
    )
    return Measurements(("body",), ("degC",), ("bath", "load"), (record,), None, ("run",))


def test_the_range_of_a_measured_input_is_that_of_its_samples() -> None:
    ranges = data_ranges(parse_family(OVEN), measured())
    assert ranges["|load|"] == pytest.approx((0.0, 50.0))
    assert ranges["input load"] == pytest.approx((-20.0, 50.0))


def test_temperatures_have_no_effects_that_scale_from_absolute_zero() -> None:
    family = parse_family(OVEN)
    ranges = data_ranges(family, measured())
    assert ranges["input bath"] == pytest.approx((300.0, 330.0))
    known = library(family)
    assert {"saturation_of_load", "dead_band_of_load"} <= set(known)
    assert not {"saturation_of_bath", "dead_band_of_bath"} & set(known)
    (play,) = (one for one in known["backlash_of_bath"].parameters if one.name == "limit")
    assert ranges[play.within] == pytest.approx((0.0, 30.0))


def test_a_temperature_threshold_is_searched_within_the_range_of_its_input() -> None:
    table = parse_family(
        "family: strip\ninputs: {oven: {value: 20 degC}}\n"
        "parameters:\n  rise: {value: 1 V/K, bounds: [0 V/K, 10 V/K]}\n"
        "  at: {value: 20 degC, bounds: [0 degC, 90 degC]}\n"
        "outputs: {volts: {unit: V, formula: rise*(oven - at)}}\n"
    )
    (limit,) = (
        one for one in library(table)["threshold_of_volts_with_oven"].parameters if one.name == "limit"
    )
    assert limit.within == "input oven"
    assert not limit.difference
