"""How far the cylinder went in a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from report.made_campaign import published_stroke
from rigctl.report.run_data import RecordData, RunData, Signal
from rigctl.report.stroke import Motion, find_motion, stroke


def excitation(
    time: np.ndarray, valve: np.ndarray, position: np.ndarray
) -> tuple[RunData, RecordData, Motion]:
    record = RecordData(0, "r", 0.0, float(time[-1]), "complete", None, {}, (), slice(0, len(time)))
    signals = {"x": Signal("x", "mm", position), "v": Signal("v", "1", valve, command=True)}
    run = RunData("id", {}, time, signals, (record,), (), (), None)
    return run, record, Motion(signals["x"], signals["v"])


def test_every_published_stroke_is_found(published_data: RunData) -> None:
    motion = find_motion(published_data)
    assert motion is not None
    assert motion.position.name == "position"
    for record in published_data.records:
        expected = published_stroke(record.sweep["oil"][0], record.sweep["supply"][0])
        assert stroke(published_data, record, motion) == pytest.approx(expected, abs=0.1)


def test_without_a_rig_file_the_only_position_and_valve_are_used(published_data: RunData) -> None:
    motion = find_motion(replace(published_data, rig=None))
    assert motion is not None
    assert (motion.position.name, motion.command.name) == ("position", "valve")


def test_leakage_after_the_stroke_is_not_counted() -> None:
    time = np.arange(0.0, 10.0, 0.01)
    valve = np.where((time >= 1.0) & (time < 2.0), 1.0, 0.0)
    position = 100.0 * np.clip(time - 1.0, 0.0, 1.0) + 5.0 * np.clip(time - 2.0, 0.0, None)
    run, record, motion = excitation(time, valve, position)
    assert stroke(run, record, motion) == pytest.approx(101.5, abs=0.1)  # 5 mm/s for 0.3 s, not for 8 s


def test_an_immediate_retract_ends_the_stroke() -> None:
    time = np.arange(0.0, 3.0, 0.01)
    valve = np.where(time < 1.0, 0.0, np.where(time < 2.0, 1.0, -1.0))
    position = 100.0 * np.clip(time - 1.0, 0.0, 1.0) - 80.0 * np.clip(time - 2.0, 0.0, None)
    run, record, motion = excitation(time, valve, position)
    assert stroke(run, record, motion) == pytest.approx(99.0, abs=1e-6)  # one sample before the turn


@pytest.mark.parametrize("valve", [0.0, 1.0, -1.0])
def test_without_a_complete_extension_there_is_no_stroke(valve: float) -> None:
    time = np.arange(0.0, 1.0, 0.01)
    run, record, motion = excitation(time, np.full_like(time, valve), np.zeros_like(time))
    assert stroke(run, record, motion) is None


def test_without_position_readings_there_is_no_stroke() -> None:
    time = np.arange(0.0, 3.0, 0.01)
    valve = np.where((time >= 1.0) & (time < 2.0), 1.0, 0.0)
    run, record, motion = excitation(time, valve, np.full_like(time, np.nan))
    assert stroke(run, record, motion) is None
