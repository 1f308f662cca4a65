"""Numbers by which loggers mark missing values, in every format: no readings, and counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from open_range import without_ranges
from rigctl.dataset import open_run
from rigctl.dataset.importing import Options, import_file, read_table
from rigctl.dataset.importing.cells.sentinels import Sentinels, blanked, remark, without_marked_times
from rigctl.dataset.importing.formats import formats
from rigctl.dataset.importing.formats.table import KEPT_FAULTS, Fault, RowBlock
from rigctl.errors import RigctlError
from rigctl.rig import Rig

BOARD = Path(__file__).parents[4] / "rigs" / "heater-board.yaml"
TIMES = np.arange(600.0)
READINGS = 20.0 + np.sin(TIMES / 50.0)


@pytest.fixture(scope="module")
def board() -> Rig:
    return without_ranges(BOARD)


def written(path: Path, readings: np.ndarray, times: np.ndarray = TIMES) -> Path:
    columns = {"time [s]": times, "temperature_1 [degC]": readings, "heater_1 [%]": 0.0 * times}
    frame = pd.DataFrame(columns)
    match path.suffix:
        case ".csv":
            frame.to_csv(path, index=False)
        case ".xlsx":
            frame.to_excel(path, index=False)
        case ".parquet":
            frame.to_parquet(path)
        case ".mat":
            from scipy.io import savemat

            savemat(
                path,
                {"time": times, "temperature_1": readings, "units": {"time": "s", "temperature_1": "degC"}},
            )
        case _:
            from nptdms import ChannelObject, TdmsWriter

            with TdmsWriter(str(path)) as writer:
                writer.write_segment(
                    [
                        ChannelObject("log", "time [s]", times),
                        ChannelObject("log", "temperature_1 [degC]", readings.astype(np.float32)),
                    ]
                )
    return path


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat", "xlsx", "tdms"])
@pytest.mark.parametrize("mark", [-9999.0, -999.9, 1e30])
def test_marks_of_missing_values_are_no_readings(tmp_path: Path, board: Rig, kind: str, mark: float) -> None:
    """The first of them far behind the rows that show the form of a file."""
    readings = READINGS.copy()
    readings[[450, 451, 599]] = mark
    done = import_file(written(tmp_path / f"log.{kind}", readings), board, tmp_path / "runs")
    samples = open_run(done.path).samples()["temperature_1"].to_numpy()
    assert np.flatnonzero(np.isnan(samples)).tolist() == [450, 451, 599]
    assert np.nanmin(samples) > 18.0
    assert any(note.startswith("temperature_1: 3 of 600 values are missing") for note in done.notes)
    if abs(mark) < 1e30:
        assert any(
            f"3 values are {mark:g}, a mark" in note and "--missing none" in note for note in done.notes
        )


def test_marks_are_not_interpolated(tmp_path: Path, board: Rig) -> None:
    readings = READINGS.copy()
    readings[450] = -9999.0
    file = written(tmp_path / "log.parquet", readings)
    done = import_file(file, board, tmp_path / "runs", options=Options(resample="0.5 s"))
    assert np.nanmin(open_run(done.path).samples()["temperature_1"].to_numpy()) > 18.0


def test_a_number_near_the_others_is_a_reading(tmp_path: Path, board: Rig) -> None:
    readings = -np.linspace(900.0, 1100.0, 600)
    readings[300] = -999.0
    file = written(tmp_path / "log.csv", readings)
    done = import_file(
        file, board, tmp_path / "runs", options=Options(columns={"temperature_1": "temperature_1 [mK]"})
    )
    assert not np.isnan(open_run(done.path).samples()["temperature_1"].to_numpy()).any()


def test_the_user_may_keep_them_and_say_others(tmp_path: Path, board: Rig) -> None:
    readings = READINGS.copy()
    readings[450] = 9999.0
    file = written(tmp_path / "log.csv", readings)
    kept = import_file(file, board, tmp_path / "runs", options=Options(missing=("none",)))
    assert open_run(kept.path).samples()["temperature_1"].to_numpy()[450] == pytest.approx(9999.0)
    assert any("--missing=9999" in note for note in kept.notes)


def test_a_draft_and_a_table_of_observations_know_them(tmp_path: Path) -> None:
    readings = READINGS.copy()
    readings[450] = -9999.0
    table = read_table(written(tmp_path / "log.csv", readings))
    assert np.isnan(table.columns[1].values[450])
    pd.DataFrame({"flow [l/min]": TIMES, "head [m]": readings}).to_csv(tmp_path / "curve.csv", index=False)
    done = import_file(tmp_path / "curve.csv", None, tmp_path / "runs")
    assert "head" not in open_run(done.path).record(450).measures
    assert any("head: 1 value is -9999" in note for note in done.notes)


@pytest.mark.parametrize("kind", ["csv", "parquet", "xlsx", "mat", "tdms"])
@pytest.mark.parametrize(("row", "mark"), [(0, -9999.0), (300, -999.9), (599, 9999.0)])
def test_a_mark_is_no_time(
    tmp_path: Path, board: Rig, monkeypatch: pytest.MonkeyPatch, kind: str, row: int, mark: float
) -> None:
    monkeypatch.setattr(formats, "isolated", False)
    times = TIMES.copy()
    times[row] = mark
    path = written(tmp_path / f"log.{kind}", READINGS, times)
    said = rf"time: a mark of a missing value, got '{mark:g}'; expected a time; '--missing none'"
    with pytest.raises(RigctlError, match=said):
        import_file(path, board, tmp_path / "runs")
    with pytest.raises(RigctlError, match=said):
        read_table(path)
    done = import_file(path, board, tmp_path / "runs", keep_good=True)
    assert (done.rows, done.left_out) == (599, 1)
    assert open_run(done.path).signals("time").tolist() == np.delete(TIMES, row).tolist()


def test_times_before_zero_may_be_marks(tmp_path: Path, board: Rig) -> None:
    path = written(tmp_path / "log.csv", READINGS, TIMES - 9999.0)
    assert import_file(path, board, tmp_path / "runs").rows == 600
    path = written(tmp_path / "log.csv", READINGS, np.array([*TIMES[:-1], 9999.0]))
    options = Options(missing=("none",))
    assert import_file(path, board, tmp_path / "runs", options=options).rows == 600


# --- the rule by itself


def marked(*parts: object, times: bool = False) -> dict[float, int]:
    """The marks that are found in a column whose values come in these parts."""
    seen = Sentinels([4], {4} if times else ())
    for part in parts:
        values = np.array(part, dtype=float)
        seen.take(RowBlock({4: values}, np.arange(len(values))))
    return seen.found().get(4, {})


EVERY = [
    *(-999.0, -999.9, -9999.0, -9999.9, -99999.0, -999999.0, 9999.0, 99999.0, 999999.0),
    *(float(np.float32(-999.9)), float(np.float32(-9999.9))),
    *(float(np.iinfo(np.int16).min), float(np.iinfo(np.int16).max), 6999.0, -6999.0, 7999.0, -7999.0),
]


def test_every_mark_is_found_among_small_values_and_no_other_number() -> None:
    assert marked([1.0, 2.0, 3.0, *EVERY]) == dict.fromkeys(EVERY, 1)
    assert marked([1.0, 2.0, 3.0, -998.0, 998.0, 32766.0, -32767.0]) == {}


@pytest.mark.parametrize(
    ("parts", "found"),
    [
        (([1.0, 2.0, 1999.8, -9999.0],), {-9999.0: 1}),  # five times as large as every other
        (([1.0, 2.0, -1999.8, 9999.0],), {9999.0: 1}),
        (([1.0, 2.0, 2000.0, -9999.0],), {}),
        (([1.0, 2.0, -2000.0, -9999.0],), {}),
        (([1.0, -9999.0, 2.0],), {}),  # of two values nothing is known
        (([-9999.0], [1.0, -9999.0], [2.0, 3.0, -999.0]), {-9999.0: 2, -999.0: 1}),
        (([1.0], [2.0], [-9999.0, 3.0], [4000.0]), {}),
        (([1.0, 2.0], [4000.0], [3.0, -9999.0]), {}),
        (([0.0, 0.0, 0.0, 9999.0],), {}),  # a command that is otherwise zero
        (([0.0, 0.0, 0.0, -9999.0],), {-9999.0: 1}),
        (([np.nan, np.nan, 1.0, 2.0, -9999.0],), {}),
        (([9.9e37, 1e30, 1.0, 2.0, 3.0, -9999.0],), {-9999.0: 1}),  # an overload is no value
        (([np.inf, 1.0, 2.0, 3.0, -9999.0],), {-9999.0: 1}),
        (([-9999.0, -9999.0],), {}),
        (([],), {}),
    ],
)
def test_a_mark_is_far_from_every_other_value_of_its_column(
    parts: tuple[list[float], ...], found: dict[float, int]
) -> None:
    assert marked(*parts) == found
    assert marked(*parts, [], [np.nan]) == found


def test_times_are_never_negative_unless_others_are() -> None:
    near = [0.0, 1.0, 9000.0, -999.0]
    assert marked(near) == {}
    assert marked(near, times=True) == {-999.0: 1}
    assert marked([*near, -5.0], times=True) == {}
    assert marked([-5.0], near, times=True) == {}
    assert marked([0.0, 1.0, 9000.0, 9999.0], times=True) == {}


def test_the_rows_whose_time_is_a_mark_become_faults_in_order() -> None:
    times, readings = np.array([0.0, -9999.0, 2.0, -999.0, 4.0]), np.arange(5.0)
    early, late = (Fault(line, "x", "y", "z") for line in (5, 14))
    part = RowBlock({0: times, 1: readings}, np.arange(11, 16), faults=(early, late), more_faults=2)
    found = without_marked_times(part, {0: [-9999.0, -999.0]}, "clock")
    assert found.columns[0].tolist() == [0.0, 2.0, 4.0]
    assert found.columns[1].tolist() == [0.0, 2.0, 4.0]
    assert [one.line for one in found.faults] == [5, 12, 14, 14]
    assert found.more_faults == 2
    assert without_marked_times(part, {0: [7.0]}, "clock") is part
    assert without_marked_times(part, {1: [7.0], 0: [-999.0]}, "clock").lines.tolist() == [11, 12, 13, 15]


def test_faults_beyond_those_kept_are_counted() -> None:
    times = np.full(KEPT_FAULTS + 3, -9999.0)
    found = without_marked_times(RowBlock({0: times}, np.arange(len(times))), {0: [-9999.0]}, "clock")
    assert (len(found.faults), found.more_faults, len(found.lines)) == (KEPT_FAULTS, 3, 0)


def test_only_the_marks_of_a_column_are_blanked_and_the_remark_counts_them() -> None:
    part = RowBlock({0: np.array([1.0, -9999.0]), 1: np.array([9999.0, -9999.0])}, np.arange(2))
    found = blanked(part, {1: [9999.0]})
    np.testing.assert_array_equal(found.columns[0], [1.0, -9999.0])
    np.testing.assert_array_equal(found.columns[1], [np.nan, -9999.0])
    assert remark("p", {-9999.0: 1}).startswith("p: 1 value is -9999, a mark")
    assert remark("p", {-9999.0: 1, -999.0: 1}).startswith("p: 2 values are -9999, -999, a mark")
