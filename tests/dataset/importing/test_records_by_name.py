"""Named records, conditions of rigs without oil, and parts that end inside a record."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rigctl.dataset import open_run
from rigctl.dataset.importing import import_file, samples
from rigctl.dataset.importing.formats import text
from rigctl.errors import RigctlError
from rigctl.rig import Rig, load_rig

RIGS = Path(__file__).parents[3] / "rigs"
STEPS = """\
time [s],record,heater_1 [%],heater_2 [%],temperature_1 [degC],temperature_2 [degC]
0,up,50,0,,
1,up,50,0,23.0,22.9
2,up,50,0,23.4,22.9
0,down,0,0,60.0,30.0
1,down,0,0,59.0,30.0
2,down,10,0,58.0,30.0
0,down again,0,0,60.4,30.2
1,down again,0,0,59.4,30.2
"""


@pytest.fixture(scope="module")
def board() -> Rig:
    return load_rig(RIGS / "heater-board.yaml")


@pytest.fixture(scope="module")
def cylinder() -> Rig:
    return load_rig(RIGS / "hl32-bench.yaml")


def write(folder: Path, text: str) -> Path:
    path = folder / "steps.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_record_keeps_the_name_that_the_file_gives_it(tmp_path: Path, board: Rig) -> None:
    run = open_run(import_file(write(tmp_path, STEPS), board, tmp_path / "runs").path)
    assert run.records["name"].tolist() == ["up", "down", "down again"]
    assert run.records["path"].tolist() == ["record up", "record down", "record down again"]
    assert [switch.record for switch in run.switches] == [1]


def test_names_of_digits_and_large_numbers_are_records_of_their_own(tmp_path: Path, board: Rig) -> None:
    labels = ["1_1", "11", "9007199254740992", "9007199254740993", "1234567", "1234568"]
    rows = "".join(f"{time},{label},20\n" for label in labels for time in (0, 1))
    path = write(tmp_path, f"time [s],record,temperature_1 [degC]\n{rows}")
    run = open_run(import_file(path, board, tmp_path / "runs").path)
    assert run.records["path"].tolist() == [f"record {label}" for label in labels]
    columns = {"time [s]": [0.0, 1.0] * 2, "record": [2**53] * 2 + [2**53 + 1] * 2}
    pq.write_table(pa.table({**columns, "temperature_1 [degC]": [20.0] * 4}), tmp_path / "large.parquet")
    run = open_run(import_file(tmp_path / "large.parquet", board, tmp_path / "runs").path)
    assert run.records["path"].tolist() == ["record 9007199254740992", "record 9007199254740993"]


def test_all_records_can_be_given_one_name(tmp_path: Path, board: Rig) -> None:
    run = open_run(import_file(write(tmp_path, STEPS), board, tmp_path / "runs", name="step").path)
    assert run.records["name"].tolist() == ["step", "step", "step"]


def test_without_oil_the_condition_is_the_levels_and_the_initial_temperatures(
    tmp_path: Path, board: Rig
) -> None:
    run = open_run(import_file(write(tmp_path, STEPS), board, tmp_path / "runs").path)
    first, second, third = (run.record(index).sweep for index in range(3))
    assert first == pytest.approx(
        {"heater_1": 0.5, "heater_2": 0.0, "temperature_1": 296.35, "temperature_2": 296.05}
    )
    assert "heater_1" not in second  # it changes inside the record
    assert second["temperature_1"] == third["temperature_1"] == pytest.approx(332.6)
    assert second["temperature_2"] == third["temperature_2"]


def test_different_spellings_of_a_number_name_the_same_record(tmp_path: Path, cylinder: Rig) -> None:
    text = "time [s],record,position [mm]\n0,01,1\n1,1,2\n2,1.0,3\n3,-1,4\n4,NA,5\n5,,5\n6,two,6\n"
    run = open_run(import_file(write(tmp_path, text), cylinder, tmp_path / "runs").path)
    assert run.signals("record").tolist() == [0, 0, 0, -1, -1, -1, 1]
    assert run.records["name"].tolist() == ["steps", "two"]


def test_a_record_name_that_returns_after_another_record_is_refused(tmp_path: Path, cylinder: Rig) -> None:
    text = "time [s],record,position [mm]\n0,a,1\n0,b,2\n1,a,3\n1,b,3\n"
    with pytest.raises(RigctlError, match="record: it has ended before, got 'a'"):
        import_file(write(tmp_path, text), cylinder, tmp_path / "runs")
    done = import_file(write(tmp_path, text), cylinder, tmp_path / "runs", keep_good=True)
    assert (done.records, done.rows, done.left_out) == (2, 3, 1)


def test_a_text_column_that_is_left_out_does_not_matter(tmp_path: Path, cylinder: Rig) -> None:
    text = "time [s],who,position [mm]\n0,Ada,1\n1,,2\n"
    done = import_file(write(tmp_path, text), cylinder, tmp_path / "runs", columns=["who=-"])
    assert done.rows == 2


@pytest.mark.parametrize(("piece", "short"), [(1, 0), (50, 1000), (200, 1 << 20), (1 << 23, 0)])
def test_the_import_does_not_depend_on_the_size_of_the_pieces_read(
    tmp_path: Path, cylinder: Rig, monkeypatch: pytest.MonkeyPatch, piece: int, short: int
) -> None:
    monkeypatch.setattr(text, "PIECE", piece)
    monkeypatch.setattr(samples, "_SHORT", short)
    rows = ["time [s],record,valve [1],oil_temperature [degC],position [mm]"]
    for record in ("a", "-1", "b"):
        rows += [f"{t / 10},{record},{int(t > 5)},{20 + t},{t * t}" for t in range(10)]
        rows.append("x,a,0,0,0")
    path = write(tmp_path, "\n".join(rows))
    done = import_file(path, cylinder, tmp_path / "runs", keep_good=True)
    run = open_run(done.path)
    assert (done.records, done.rows, done.left_out) == (2, 30, 3)
    assert [fault.line for fault in done.faults] == [12, 23, 34]
    assert run.signals("record").tolist() == [0] * 10 + [-1] * 10 + [1] * 10
    assert run.records["rate"].tolist() == [10.0, 10.0]
    assert run.records["oil_temperature"].tolist() == pytest.approx([24.5, 24.5])
    assert [(s.record, s.time) for s in run.switches] == [(r, pytest.approx(0.55)) for r in (0, -1, 1)]
    assert run.records["end"].tolist() == pytest.approx([0.9, 0.9])


def test_a_compressed_file_is_imported_directly(tmp_path: Path, board: Rig) -> None:
    path = tmp_path / "steps.csv.gz"
    path.write_bytes(gzip.compress(STEPS.encode("utf-8")))
    done = import_file(path, board, tmp_path / "runs")
    assert (done.records, done.rows) == (3, 8)
    assert done.run.endswith("-steps")
    path.write_bytes(gzip.compress(STEPS.encode("utf-8"))[:-20])
    with pytest.raises(RigctlError, match="the file is damaged"):
        import_file(path, board, tmp_path / "runs")


def test_notes_on_suspicious_data_are_returned_and_kept_as_events(tmp_path: Path, board: Rig) -> None:
    rows = ["time [s],heater_1 [%],temperature_1 [degC],temperature_2 [degC]"]
    rows += [f"{t if t < 15 else t + 4},50,23,{'' if t == 3 else 20 + t}" for t in range(20)]
    done = import_file(write(tmp_path, "\n".join(rows)), board, tmp_path / "runs")
    assert done.notes == (
        "not in the file: heater_2; if it stayed at one value, say so: --assume heater_2=VALUE",
        "temperature_1: the same value, 23 degC, in all 20 samples; is the sensor connected?",
        "temperature_2: 1 of 20 values are missing (5 %); they stay missing",
        "gaps in time in 1 of 1 records; the longest: 5 s from 14 s on in record 0. "
        "'--split gap' makes a record of each stretch",
    )
    events = open_run(done.path).events
    assert events[events["kind"] == "note"]["message"].tolist() == list(done.notes)
    assert events[events["kind"] == "gap"]["message"].tolist() == ["no samples for 5 s from 14 s on"]


def test_a_channel_without_any_value_is_reported(tmp_path: Path, cylinder: Rig) -> None:
    text = "time [s],position [mm],supply_pressure [bar]\n0,1,\n1,2,nan\n"
    done = import_file(write(tmp_path, text), cylinder, tmp_path / "runs")
    assert "supply_pressure: no value at all" in done.notes
    assert np.isnan(open_run(done.path).signals("supply_pressure")).all()


def test_observations_can_be_imported_without_a_rig_and_samples_cannot(tmp_path: Path) -> None:
    text = "oil_temperature [degC],kinematic_viscosity [cSt],record\n20,85.19,first\n40,33.81,\n"
    run = open_run(import_file(write(tmp_path, text), None, tmp_path / "runs").path)
    assert run.records["name"].tolist() == ["first", "steps"]
    assert run.record(1).sweep == pytest.approx({"oil_temperature": 313.15})
    assert run.record(1).measures == pytest.approx({"kinematic_viscosity": 33.81e-6})
    assert " on " not in run.summary()
    with pytest.raises(RigctlError, match="samples belong to a rig"):
        import_file(write(tmp_path, STEPS), None, tmp_path / "runs")


def test_an_observation_that_is_not_finite_is_a_bad_row(tmp_path: Path, board: Rig) -> None:
    text = "oil_temperature [degC],kinematic_viscosity [cSt]\n20,inf\n40,33.81\n"
    with pytest.raises(RigctlError, match="not a number"):
        import_file(write(tmp_path, text), board, tmp_path / "runs")
    table = pa.table({"oil_temperature [degC]": [20.0, 40.0], "kinematic_viscosity [cSt]": [math.inf, 33.81]})
    pq.write_table(table, tmp_path / "table.parquet")
    with pytest.raises(RigctlError, match="not a finite number"):
        import_file(tmp_path / "table.parquet", None, tmp_path / "runs")
    assert import_file(tmp_path / "table.parquet", None, tmp_path / "runs", keep_good=True).rows == 1
