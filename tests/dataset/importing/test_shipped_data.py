"""The shipped data, imported as described in its README."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.dataset import Run, open_run
from rigctl.dataset.importing import Imported, import_file
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig


def bring_in(file: str, rig: str | None, folder: Path) -> tuple[Imported, Run]:
    bench = load_rig(shipped("rigs", rig)) if rig is not None else None
    done = import_file(shipped("data", file), bench, folder)
    return done, open_run(done.path)


def test_the_heater_board_steps_are_imported_with_their_records(tmp_path: Path) -> None:
    done, run = bring_in("heater-board-steps.csv", "heater-board.yaml", tmp_path)
    assert (done.records, done.rows, done.left_out) == (20, 24020, 0)
    levels = [*range(10, 110, 10)]
    assert run.records["name"].tolist() == [
        *(f"H1_000_{level:03d}" for level in levels),
        *(f"H1_{level:03d}_000" for level in levels),
    ]
    assert run.records["heater_1"].tolist() == pytest.approx([*levels, *[0] * 10])
    assert run.layout.channels == ("temperature_1", "temperature_2")  # no record has the room temperature
    for index in run.usable:
        record = run.record(index)
        assert record.time.tolist() == list(range(1201))
        for values in record.channels.values():  # the placeholders of the source, and no others, are missing
            assert np.flatnonzero(np.isnan(values)).tolist() == [0]
    hottest = run.record(19)
    assert hottest.channels["temperature_1"][1] == pytest.approx(117.64 + 273.15)
    assert len({tuple(run.record(index).sweep.values()) for index in run.usable}) == 20


def test_the_published_viscosities_are_imported_as_observations(tmp_path: Path) -> None:
    done, run = bring_in("hl32-viscosity.csv", None, tmp_path)
    assert (done.records, done.rows) == (13, 13)
    record = run.record(4)
    assert record.sweep == pytest.approx({"oil_temperature": 313.15})
    assert record.measures["kinematic_viscosity"] == pytest.approx(33.81e-6)
    assert record.measures["dynamic_viscosity"] == pytest.approx(0.0289)
    assert record.usable
    assert len(record.time) == 0


def test_the_published_strokes_are_imported_with_their_losses(tmp_path: Path) -> None:
    _, run = bring_in("hl32-strokes.csv", "hl32-bench.yaml", tmp_path)
    cold, hot = [run.record(i) for i in range(4)], [run.record(i) for i in range(4, 8)]
    for before, after, pressure, share in zip(cold, hot, (20, 30, 40, 50), (4.8, 6.0, 6.5, 4.8), strict=True):
        assert before.sweep == pytest.approx({"oil_temperature": 293.15, "relief_valve": pressure * 1e5})
        assert after.sweep == pytest.approx({"oil_temperature": 333.15, "relief_valve": pressure * 1e5})
        loss = after.measures["stroke_loss"]
        assert before.measures["stroke"] - after.measures["stroke"] == pytest.approx(loss)
        assert 100 * loss / before.measures["stroke"] == pytest.approx(share, abs=0.05)


def test_the_unknown_bench_is_imported_with_32_records_at_28_conditions(tmp_path: Path) -> None:
    done, run = bring_in("unknown-bench.csv", "hl32-bench.yaml", tmp_path)
    assert (done.records, done.rows, done.left_out) == (32, 32 * 376, 0)
    points = [tuple(run.record(index).sweep.values()) for index in run.usable]
    assert len(set(points)) == 28
    assert {round(celsius - 273.15) for celsius, _ in points} == {20, 30, 40, 50, 60, 70, 80}
    assert len(run.record(0).switches) == 3
