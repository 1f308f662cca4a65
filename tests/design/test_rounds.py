"""No proposal of the search on a shipped rig trips an interlock.

A sample of the ten thousand rounds of `python -m benchmarks.rounds`, on each kind of rig.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.files.shipped import shipped
from rigctl_validation.designed.shipped_benches import BENCHES, proposer


def test_every_shipped_rig_has_a_bench() -> None:
    an_example = "line-device"  # to be changed into one's own: it has no model
    as_several = "oil-circuit-devices"  # the bench of oil-circuit-modbus, as three devices
    assert {*BENCHES, an_example, as_several} == {path.stem for path in shipped("rigs").glob("*.yaml")}


@pytest.mark.parametrize("rig", ["hl32-bench", "heater-board", "oil-circuit-modbus"])
def test_no_proposed_round_trips_an_interlock(rig: str, tmp_path: Path) -> None:
    tally = proposer(rig, tmp_path).carry_out(12, seed=7)
    assert tally.carried_out == 12
    assert (tally.failed, tally.tripped) == (0, ())
