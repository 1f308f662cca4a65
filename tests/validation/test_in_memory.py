"""Measurements of a campaign made in memory are those that the run files give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.dataset import open_run
from rigctl.files.shipped import shipped
from rigctl.model.measured import read_measurements
from rigctl_validation.campaign_run import make_run
from rigctl_validation.in_memory import measure
from rigctl_validation.scenario import Scenario
from rigctl_validation.work import bench_model


@pytest.mark.parametrize("chambers", [False, True])
def test_measurements_made_in_memory_equal_those_read_from_a_run(tmp_path: Path, chambers: bool) -> None:
    scenario = Scenario(
        "nothing",
        noise="all",
        chamber_pressures=chambers,
        repeated=1,
        temperatures=(20.0, 60.0),
        pressures=(30.0,),
    )
    name = "hl32-bench-instrumented.yaml" if chambers else "hl32-bench.yaml"
    model, rig = bench_model(chambers)
    found = measure(scenario.plain, model, rig)
    run = open_run(make_run(scenario.plain, shipped("rigs", name), tmp_path))
    read = read_measurements(model, [run])
    assert (found.outputs, found.units, found.inputs) == (read.outputs, read.units, read.inputs)
    assert len(found.records) == len(read.records) == 3
    for one, other in zip(found.records, read.records, strict=True):
        np.testing.assert_allclose(one.times, other.times, atol=1e-9)
        np.testing.assert_allclose(one.switch_times, other.switch_times, atol=1e-9)
        np.testing.assert_array_equal(one.switch_half, other.switch_half)
        np.testing.assert_array_equal(one.inputs, other.inputs)
        np.testing.assert_allclose(one.values, other.values, rtol=1e-12)
        np.testing.assert_array_equal(one.phase, other.phase)
        assert (one.phases, one.group, one.condition) == (other.phases, other.group, other.condition)
