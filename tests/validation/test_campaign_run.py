"""Campaigns of the separate bench as runs that the rest of the tool reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl_validation.bench.campaign import Campaign, simulate_records
from rigctl_validation.campaign_run import make_run

RIGS = Path(__file__).parents[2] / "rigs"
SMALL = Campaign(temperatures=(20.0, 60.0), pressures=(20.0,), repeated=1)


def test_a_run_has_the_samples_and_exact_switches_of_the_simulated_records(tmp_path: Path) -> None:
    run = open_run(make_run(SMALL, RIGS / "hl32-bench.yaml", tmp_path))
    assert run.usable == (0, 1, 2)
    for index, made in enumerate(simulate_records(SMALL)):
        record = run.record(index)
        np.testing.assert_allclose(record.time - record.start, made.time, atol=1e-9)
        np.testing.assert_array_equal(record.commands["valve"], made.command)
        for name, values in made.channels.items():
            np.testing.assert_allclose(record.channels[name], values, rtol=1e-12, atol=1e-12)
        valve = [switch for switch in record.switches if switch.actuator == "valve"]
        assert [switch.value for switch in valve] == [1.0, 0.0, -1.0]
        assert [switch.time - record.start for switch in valve] == pytest.approx([0.2, 1.25, 2.25])
        assert all(switch.uncertainty == 0.0 for switch in valve)
    assert run.record(1).sweep == run.record(2).sweep


def test_an_imported_run_has_switch_times_to_within_half_a_sample(tmp_path: Path) -> None:
    run = open_run(make_run(SMALL, RIGS / "hl32-bench.yaml", tmp_path, imported=True))
    switches = [switch for switch in run.record(0).switches if switch.actuator == "valve"]
    assert [switch.time for switch in switches] == pytest.approx([0.195, 1.245, 2.245])
    assert switches[0].uncertainty == pytest.approx(0.005)
    assert len(list(tmp_path.iterdir())) == 1


def test_chamber_pressures_need_a_rig_with_their_channels(tmp_path: Path) -> None:
    campaign = Campaign(temperatures=(20.0,), pressures=(20.0,), chamber_pressures=True)
    with pytest.raises(RigctlError, match="pressure_a"):
        make_run(campaign, RIGS / "hl32-bench.yaml", tmp_path)
    run = open_run(make_run(campaign, RIGS / "hl32-bench-instrumented.yaml", tmp_path))
    assert "pressure_b" in run.record(0).channels
