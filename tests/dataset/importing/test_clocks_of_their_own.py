"""Channels with separate times: long format, a time for each channel, rasters of MDF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal
from hypothesis import given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter

from rigctl.dataset import Run, open_run
from rigctl.dataset.importing import Options, import_file
from rigctl.dataset.importing.formats import formats
from rigctl.errors import RigctlError
from rigctl.rig import Rig, load_rig

BOARD = Path(__file__).parents[3] / "rigs" / "heater-board.yaml"
LONG = {"sensor": "channel", "reading": "value", "T1": "temperature_1 [degC]", "T2": "temperature_2 [degC]"}


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The readers themselves; test_hostile_files.py and the journeys run them apart."""
    monkeypatch.setattr(formats, "isolated", False)


@pytest.fixture(scope="module")
def board() -> Rig:
    return load_rig(BOARD)


def run_of(path: Path, rig: Rig, **options: Any) -> Run:
    return open_run(import_file(path, rig, path.parent / "runs", options=Options(**options)).path)


def celsius(run: Run, name: str, record: int = 0) -> Any:
    return run.record(record).channels[name] - 273.15


def test_long_format_with_one_value_per_row_is_imported(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "long.csv"
    rows = ["time [s],sensor,reading"]
    rows += [f"{k / 10},T1,{20 + k}" for k in range(11)] + [f"{k},T2,{30 + k}" for k in range(2)]
    path.write_text("\n".join(rows), encoding="utf-8")
    run = run_of(path, board, columns=LONG)
    assert len(run.record(0).time) == 11
    assert np.isnan(celsius(run, "temperature_2")).sum() == 9
    run = run_of(path, board, columns=LONG, resample="250 ms")
    assert run.record(0).time == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    assert celsius(run, "temperature_1") == pytest.approx([20.0, 22.5, 25.0, 27.5, 30.0])
    assert celsius(run, "temperature_2") == pytest.approx([30.0, 30.25, 30.5, 30.75, 31.0])
    run = run_of(path, board, columns=LONG, resample="temperature_2")
    assert run.record(0).time.tolist() == [0.0, 1.0]


def test_a_table_with_a_time_column_for_each_channel_is_imported(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "pairs.csv"
    path.write_text(
        "t1 [s];temperature_1 [degC];t2 [ms];temperature_2 [degC];t3 [s];heater_1 [%]\n"
        "0;20;0;30;0;0\n1;21;1500;33;1,5;50\n2;22;;;;\n",
        encoding="utf-8",
    )
    columns = {"t1": "time [s]", "t2": "time of temperature_2 [ms]", "t3": "time of heater_1 [s]"}
    run = run_of(path, board, columns=columns, resample="500 ms")
    assert run.record(0).time == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
    assert celsius(run, "temperature_2") == pytest.approx([30, 31, 32, 33, np.nan], nan_ok=True)
    assert run.record(0).commands["heater_1"].tolist() == [0.0, 0.0, 0.0, 0.5, 0.5]
    with pytest.raises(RigctlError, match=r"temperature_2 has a clock of its own; expected --resample"):
        run_of(path, board, columns=columns)
    with pytest.raises(RigctlError, match="did you mean 'temperature_1'"):
        run_of(path, board, columns={**columns, "t2": "time of temperatur_1 [ms]"}, resample="1 s")


@pytest.mark.parametrize("ending", ["mf4", "tdms"])
def test_groups_with_different_rates_become_one_record(tmp_path: Path, board: Rig, ending: str) -> None:
    path = tmp_path / f"rasters.{ending}"
    fast, slow = np.arange(0, 2.0, 0.01), np.arange(0, 2.0, 0.5)
    if ending == "mf4":
        with MDF(version="4.10") as made:
            made.append(Signal(20 + fast, fast, name="temperature_1", unit="degC"), acq_name="fast")
            made.append(Signal(30 + slow, slow, name="temperature_2", unit="degC"), acq_name="slow")
            made.save(path)
    else:
        degrees = {"unit_string": "degC"}
        with TdmsWriter(str(path)) as writer:
            first = ChannelObject("fast", "temperature_1", 20 + fast, {**degrees, "wf_increment": 0.01})
            second = ChannelObject("slow", "temperature_2", 30 + slow, {**degrees, "wf_increment": 0.5})
            writer.write_segment([first, second])
    with pytest.raises(RigctlError, match="--resample '100 ms'"):
        run_of(path, board)
    run = run_of(path, board, resample="100 ms")
    assert run.info["records"] == 1
    assert celsius(run, "temperature_1")[:16] == pytest.approx(20 + 0.1 * np.arange(16))
    assert celsius(run, "temperature_2")[:16] == pytest.approx(30 + 0.1 * np.arange(16))


@given(
    slow=st.lists(st.floats(0.2, 0.6), min_size=3, max_size=15),
    fast=st.lists(st.floats(0.02, 0.06), min_size=10, max_size=60),
    step=st.floats(0.05, 0.4),
)
@settings(max_examples=30)
def test_linear_signals_stay_linear_and_are_not_extrapolated(
    tmp_path_factory: pytest.TempPathFactory, board: Rig, slow: list[float], fast: list[float], step: float
) -> None:
    """Both channels are linear in time, so interpolation is exact; beyond their samples they are NaN."""
    path = tmp_path_factory.mktemp("clocks") / "long.csv"
    times = {"T1": np.cumsum(fast), "T2": np.cumsum(slow)}
    rows = ["time [s],sensor,reading"]
    rows += [f"{time!r},{name},{20 + 3 * time!r}" for name, own in times.items() for time in own.tolist()]
    path.write_text("\n".join(rows), encoding="utf-8")
    run = run_of(path, board, columns=LONG, resample=f"{step!r} s")
    grid = run.record(0).time
    assert np.diff(grid) == pytest.approx(step)
    for name, column in (("T1", "temperature_1"), ("T2", "temperature_2")):
        found, own = celsius(run, column), times[name]
        inside = (grid >= own[0]) & (grid <= own[-1])
        assert found[inside] == pytest.approx(20 + 3 * grid[inside], abs=1e-6)
        assert np.isnan(found[~inside]).all()


def test_a_gap_is_not_bridged(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "gap.csv"
    times = [*range(10), *range(30, 40)]
    path.write_text(
        "time [s],temperature_1 [degC]\n" + "".join(f"{t},{t}\n" for t in times), encoding="utf-8"
    )
    run = run_of(path, board, resample="1 s")
    assert np.isnan(celsius(run, "temperature_1")).sum() == 20
    for step, said in (
        ("10 bar", "wrong dimension"),
        ("0 s", "not a step"),
        ("speed", "unknown column to resample"),
    ):
        with pytest.raises(RigctlError, match=said):
            run_of(path, board, resample=step)


def test_a_clock_that_starts_again_is_refused_and_never_sorted(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "again.csv"
    rows = [f"{t},20" for t in range(5)] + [f"{t + 0.5},80" for t in range(5)]
    path.write_text("\n".join(["time [s],temperature_1 [degC]", *rows]), encoding="utf-8")
    with pytest.raises(RigctlError, match=r"again.csv:7: time: it goes back within a channel, got '0.5 s'"):
        run_of(path, board, resample="500 ms")
    run = run_of(path, board, resample="500 ms", times="drop")
    assert celsius(run, "temperature_1").tolist()[:9] == pytest.approx([20.0] * 9)


def test_values_that_repeat_a_time_in_long_format_are_told_or_spread(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "twice.csv"
    path.write_text("time [s],sensor,reading\n0,T1,20\n1,T1,21\n1,T1,99\n2,T1,22\n", encoding="utf-8")
    columns = {name: ours for name, ours in LONG.items() if name != "T2"}
    options = Options(columns=columns)
    done = import_file(path, board, tmp_path / "first", options=options)
    assert any(
        "T1: 1 values have the time of an earlier one" in note and "line 4" in note for note in done.notes
    )
    assert celsius(open_run(done.path), "temperature_1") == pytest.approx([20.0, 21.0, 22.0])
    run = run_of(path, board, columns=columns, times="spread")
    assert run.signals("time").tolist() == [0.0, 1.0, 1.5, 2.0]
    assert celsius(run, "temperature_1") == pytest.approx([20.0, 21.0, 99.0, 22.0])


def test_a_time_that_goes_back_in_long_format_is_refused_or_dropped(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "back.csv"
    path.write_text("time [s],sensor,reading\n0,T1,20\n1,T1,21\n0.5,T1,99\n2,T1,22\n", encoding="utf-8")
    columns = {name: ours for name, ours in LONG.items() if name != "T2"}
    with pytest.raises(RigctlError, match=r"back.csv:4: time: it goes back within a channel"):
        run_of(path, board, columns=columns)
    run = run_of(path, board, columns=columns, times="drop")
    assert celsius(run, "temperature_1")[~np.isnan(celsius(run, "temperature_1"))] == pytest.approx(
        [20.0, 21.0, 22.0]
    )


def test_values_that_repeat_a_time_are_told_or_spread_when_resampled(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "bus.csv"
    rows = ["0,20", "1,30", "1,40", "2,50"]
    path.write_text("\n".join(["time [s],temperature_1 [degC]", *rows]), encoding="utf-8")
    done = import_file(path, board, tmp_path / "runs", options=Options(resample="500 ms"))
    assert any("temperature_1: 1 values have the time of an earlier one" in note for note in done.notes)
    assert celsius(open_run(done.path), "temperature_1") == pytest.approx([20.0, 25.0, 30.0, 40.0, 50.0])
    run = run_of(path, board, resample="500 ms", times="spread")
    assert celsius(run, "temperature_1") == pytest.approx([20.0, 25.0, 30.0, 40.0, 50.0])


def test_marks_of_missing_values_are_found_among_32_bit_numbers(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "single.parquet"
    values = pa.array([20.0, 9.9e37, -999.9, 22.0], pa.float32())
    pq.write_table(pa.table({"time [s]": [0.0, 1.0, 2.0, 3.0], "temperature_1 [degC]": values}), path)
    run = run_of(path, board, missing=("-999.9",))
    assert celsius(run, "temperature_1") == pytest.approx([20.0, np.nan, np.nan, 22.0], nan_ok=True)


def test_marks_of_missing_values_are_found_in_a_table_of_observations(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    table = {
        "oil_temperature [degC]": [20.0, 30.0, 40.0],
        "kinematic_viscosity [mm^2/s]": [85.0, -9999.0, 9.9e37],
    }
    pq.write_table(pa.table(table), path)
    done = import_file(path, None, tmp_path / "runs", options=Options(missing=("-9999",)))
    found = open_run(done.path).records["kinematic_viscosity"]
    assert np.isfinite(found).tolist() == [True, False, False]
