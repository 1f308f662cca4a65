from __future__ import annotations

import sys
from pathlib import Path

import pytest

from torture.endings import Tally, available, one, torture

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a trial is a process of its own, by fork")


def test_runs_ending_at_random_moments_are_safe_keep_samples_and_report_the_end(tmp_path: Path) -> None:
    tally = torture(tmp_path, 16, seed=1, kinds=available())
    assert tally.failures == []
    assert tally.judged_in_time >= 3
    assert tally.statuses["aborted"] >= 2
    assert tally.statuses["failed"] >= 2
    assert tally.conditions["recovered"] >= 1, "what was killed"


@pytest.mark.skipif(sys.platform != "linux", reason="simavr is packaged for Linux only")
def test_samples_received_while_reconnecting_at_the_end_are_kept(tmp_path: Path) -> None:
    one(tmp_path, "1-115", "emulated", Tally())  # noise on the line: 0.68 s of samples used to be discarded


def test_a_loose_contact_hides_no_temperature_from_an_ending(tmp_path: Path) -> None:
    tally = torture(tmp_path, 6, seed=5, kinds=available(), beside="intermittent")
    assert tally.failures == []
    assert any("limit" in kind for kind in tally.slowest_off)


def test_a_device_that_restarts_leaves_no_output_on_at_an_ending(tmp_path: Path) -> None:
    tally = torture(
        tmp_path, 4, seed=5, kinds=[kind for kind in available() if kind != "simulated"], beside="restart"
    )
    assert tally.failures == []
