from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from open_range import without_ranges
from rigctl.dataset import Run, Switch, list_runs, open_run, verify
from rigctl.dataset.importing import Imported, Options, import_file, import_files
from rigctl.dataset.importing.formats.table import KEPT_FAULTS
from rigctl.errors import RigctlError, SeveralErrors
from rigctl.rig import Rig, load_rig

RIG = Path(__file__).parents[3] / "rigs" / "hl32-bench.yaml"
STROKES = """\
time [s],record,valve [1],oil_temperature [degC],supply_pressure [bar],pressure_setpoint [bar],position [mm]
0.00,0,0,39.9,30.1,30,0
0.01,0,1,40.0,30.0,30,
0.02,0,1,40.1,29.9,30,1.5
0.03,0,0,40.0,29.8,30,2.5
0.00,1,1,40.6,40.1,40,0
0.01,1,1,40.6,40.1,40,1
0.02,1,-1,40.6,40.1,40,2
"""


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(RIG)


class Importer:
    """Imports texts as files into one runs folder."""

    def __init__(self, folder: Path, rig: Rig) -> None:
        self.folder, self.rig = folder, rig
        self.runs = folder / "runs"

    def bring_in(self, text: str | bytes, **how: object) -> Imported:
        file = self.folder / "strokes.csv"
        file.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
        return import_file(file, self.rig, self.runs, **how)  # type: ignore[arg-type]

    def run(self, text: str | bytes, **how: object) -> Run:
        return open_run(self.bring_in(text, **how).path)

    def refusal(self, text: str | bytes, **how: object) -> RigctlError:
        with pytest.raises(RigctlError) as caught:
            self.bring_in(text, **how)
        assert not self.runs.exists() or not list(self.runs.iterdir())
        return caught.value


@pytest.fixture
def importer(tmp_path: Path, rig: Rig) -> Importer:
    return Importer(tmp_path, rig)


def test_a_file_of_strokes_becomes_a_run(importer: Importer) -> None:
    done = importer.bring_in(STROKES)
    assert (done.records, done.rows, done.left_out) == (2, 7, 0)
    assert verify(done.path).condition.value == "whole"
    run = open_run(done.run, importer.runs)
    assert run.layout.channels == ("oil_temperature", "supply_pressure", "position")
    assert run.layout.commands == ("valve", "relief_valve")
    assert run.info["source"] == "import"
    assert run.info["backend"]["file"] == "strokes.csv"
    assert run.usable == (0, 1)
    record = run.record(0)
    assert record.time.tolist() == [0.0, 0.01, 0.02, 0.03]
    assert record.channels["supply_pressure"] == pytest.approx([30.1e5, 30e5, 29.9e5, 29.8e5])
    assert record.channels["oil_temperature"][0] == pytest.approx(313.05)
    assert np.isnan(record.channels["position"]).tolist() == [False, True, False, False]
    assert record.commands["relief_valve"] == pytest.approx([30e5] * 4)
    assert record.rate == 100.0


def test_switch_times_are_known_to_within_a_sample_and_belong_to_their_record(importer: Importer) -> None:
    run = importer.run(STROKES)
    first, second = run.record(0).switches, run.record(1).switches
    assert [(s.actuator, s.value) for s in first] == [("valve", 1.0), ("valve", 0.0)]
    assert [s.time for s in first] == pytest.approx([0.005, 0.025])
    assert [s.uncertainty for s in first] == pytest.approx([0.005, 0.005])
    assert second == (Switch(pytest.approx(0.015), "valve", -1.0, pytest.approx(0.005), 1),)


def test_the_condition_is_the_setpoint_and_the_median_temperature(importer: Importer) -> None:
    run = importer.run(STROKES)
    assert run.records["relief_valve"].tolist() == [30.0, 40.0]
    # 40.0 and 40.6 are within a kelvin: one condition
    assert run.records["oil_temperature"].tolist() == pytest.approx([40.3, 40.3])


def test_rows_between_records_are_kept(importer: Importer) -> None:
    run = importer.run("time [s],record,position [mm]\n0,-1,0\n1,,0\n2,4,1\n3,4,2\n4,-1,2\n5,9,3\n")
    assert run.signals("record").tolist() == [-1, -1, 0, 0, -1, 1]
    assert run.records["path"].tolist() == ["record 4", "record 9"]


def test_without_a_record_column_a_file_is_one_record(importer: Importer) -> None:
    run = importer.run("time [s],position [mm]\n0,0\n1,5\n")
    assert run.records["record"].tolist() == [0]
    assert run.signals("position", 0).tolist() == [0.0, 0.005]


@pytest.mark.parametrize(
    "text",
    [
        "time [s];position [mm]\n0,0;1,5\n0,1;2,5\n",
        "time [s];position [mm]\n0;1,5\n0,1;2,5\n",
        "time [s];oil_temperature [degC];position [mm]\n0;20;1.5\n0.1;20;2.5\n",
        "time [s]\tposition [mm]\n0.0\t1.5\n0.1\t2.5\n",
        "\ufefftime [s],position [mm]\r\n0.0,1.5\r\n0.1,2.5\r\n",
        "# made by a logger\n\n# on a Monday\ntime [s],position [mm]\n0.0, 1.5\n\n0.1, +2.5\n",
        'time [s],"position [mm]"\n"0.0","1.5"\n0.1,2.5',
        "time [ms],position [cm]\n0,.15\n1e2,0.25\n",
        "time [sec],position [mm],oil_temperature [deg C]\n0,1.5,20\n0.1,2.5,20\n",
        "time [s],position [mm],supply_pressure [bar]\n0,1.5,NA\n.1,2.5,\n",
    ],
)
def test_common_csv_notations_give_the_same_values(importer: Importer, text: str) -> None:
    run = importer.run(text)
    assert run.signals("time") == pytest.approx([0.0, 0.1])
    assert run.signals("position") == pytest.approx([0.0015, 0.0025])


def test_foreign_column_names_are_mapped_with_their_units(importer: Importer) -> None:
    text = "t,Druck,Weg [cm],comment\n0,30,1,7\n1,31,2,8\n"
    run = importer.run(text, columns=["t=time [s], Druck=supply_pressure [bar]", "Weg=position", "comment=-"])
    assert run.signals("supply_pressure") == pytest.approx([30e5, 31e5])
    assert run.signals("position") == pytest.approx([0.01, 0.02])
    assert run.layout.channels == ("supply_pressure", "position")


def test_common_names_are_kept_if_the_rig_lacks_them(importer: Importer) -> None:
    run = importer.run("time [s],pressure_a [bar],ambient_temperature [degC]\n0,10,20\n1,11,21\n")
    assert run.layout.channels == ("pressure_a", "ambient_temperature")
    assert run.signals("ambient_temperature") == pytest.approx([293.15, 294.15])


@pytest.mark.parametrize(
    ("heading", "what", "column"),
    [
        ("time [s],positon [mm]", "unknown column", 10),
        ("time [s],position", "position: the unit is missing", 10),
        ("time [s],position [bar]", "position: wrong dimension", 10),
        ("time [s],position [mn]", "unknown unit", 10),
        ("time [s],position [mm],position [mm]", "the column is there twice", 24),
        ("time [s],", "unknown column", 10),
        ("time [mm],position [mm]", "time: wrong dimension", 1),
    ],
)
def test_a_wrong_heading_is_reported_with_its_place(
    importer: Importer, heading: str, what: str, column: int
) -> None:
    cells = ",".join("1" * (heading.count(",") + 1))
    problem = importer.refusal(f"{heading}\n{cells}\n")
    assert problem.what == what
    assert (problem.where.line, problem.where.column) == (1, column)


def test_a_misspelt_column_is_reported_with_the_correction(importer: Importer) -> None:
    problem = importer.refusal("time [s],positon [mm]\n0,1\n")
    assert problem.nearest == "position"
    assert "--columns 'positon=position'" in str(problem.hint)


@pytest.mark.parametrize(
    ("columns", "what"),
    [
        (["Druck"], "--columns: not a pair"),
        (["=position"], "--columns: not a pair"),
        (["time=time,time=position"], "--columns: the column is named twice"),
        (["positoin=position"], "unknown column"),
    ],
)
def test_a_wrong_mapping_is_reported(importer: Importer, columns: list[str], what: str) -> None:
    problem = importer.refusal("time [s],position [mm]\n0,1\n", columns=columns)
    assert problem.what == what


BAD = """\
time [s],record,valve [1],position [mm]
0.00,0,0,1
0.01,0,x,1
0.02,0,0
0.03,0,2,1
0.02,0,0,1
0.05,0.5,0,1
,0,0,1
0.06,0,0,1e999
0.00,1,0,1
0.07,0,0,1
1e300,1,0,1
"""


def test_bad_rows_are_reported_by_line_and_nothing_is_imported(importer: Importer) -> None:
    problem = importer.refusal(BAD)
    assert isinstance(problem, SeveralErrors)
    told = {
        error.where.line: (error.what, error.value)
        for error in problem.errors
        if error.where.line is not None
    }
    assert told == {
        3: ("valve: not a number", "x"),
        4: ("wrong number of cells", "3 cells"),
        5: ("valve: no such position", "2"),
        6: ("time: it does not increase within a record", "0.02 s"),
        7: ("record: not a whole number", "0.5"),
        8: ("time: the value is missing", None),
        9: ("position: not a number", "1e999"),
        11: ("record: it has ended before", "0"),
        12: ("time: too far away", "1e+300 s"),
    }
    assert problem.errors[0].where.column == 8
    assert "9 bad rows" in problem.errors[-1].what
    assert "--keep-good" in str(problem.errors[-1].hint)


def test_keep_good_omits_bad_rows_and_records_it(importer: Importer) -> None:
    done = importer.bring_in(BAD, keep_good=True)
    assert (done.records, done.rows, done.left_out) == (2, 2, 9)
    run = open_run(done.path)
    gaps = run.events[run.events["kind"] == "gap"]["message"].tolist()
    assert len(gaps) == 9
    assert gaps[0].startswith("strokes.csv:3:8: valve: not a number")


def test_many_bad_rows_are_counted(importer: Importer) -> None:
    problem = importer.refusal("time [s],position [mm]\n" + "1,x\n" * 100)
    assert isinstance(problem, SeveralErrors)
    assert len(problem.errors) == 21
    assert problem.errors[-1].what == "nothing was imported: 100 bad rows, 80 of them not listed"


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "the file has no heading"),
        ("# nothing\n\n", "the file has no heading"),
        ("time [s],position [mm]\n", "there is nothing to import"),
    ],
)
def test_a_file_without_numbers_is_reported(importer: Importer, text: str | bytes, what: str) -> None:
    assert importer.refusal(text).what == what


def test_missing_and_unknown_files_are_reported(importer: Importer, tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="cannot read the file"):
        import_file(tmp_path / "none.csv", importer.rig, importer.runs)
    with pytest.raises(RigctlError, match="unknown kind of file"):
        import_file(tmp_path / "log.ods", importer.rig, importer.runs)


def test_observations_are_a_table_without_time(importer: Importer) -> None:
    text = "oil_temperature [degC],pressure_setpoint [bar],stroke [mm]\n20,30,97\n60,30,91.2\n80,30,\n"
    done = importer.bring_in(text)
    assert (done.records, done.rows) == (3, 3)
    run = open_run(done.path)
    assert run.records["oil_temperature"].tolist() == [20.0, 60.0, 80.0]
    assert run.records["relief_valve"].tolist() == [30.0, 30.0, 30.0]
    assert run.records["stroke"].fillna(-1.0).tolist() == [97.0, 91.2, -1.0]
    assert run.records.attrs["units"]["stroke"] == "mm"
    assert run.record(1).sweep == pytest.approx({"oil_temperature": 333.15, "relief_valve": 30e5})
    assert run.record(1).measures == pytest.approx({"stroke": 0.0912})
    assert run.record(2).measures == {}


def test_a_disk_that_fails_while_it_is_written_leaves_no_run(
    importer: Importer, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rigctl.dataset.recording import finalise as finalise_module

    def fail(*_: object) -> None:
        raise RigctlError("cannot write the file: No space left on device")

    monkeypatch.setattr(finalise_module, "write_table", fail)
    assert "No space left" in importer.refusal(STROKES).what


_KILLED = """
import os, sys
from pathlib import Path
from rigctl.dataset.importing import import_file
from rigctl.dataset.recording.writer import RunWriter
from rigctl.rig import load_rig
RunWriter.close = lambda *_: os._exit(9)
import_file(Path(sys.argv[1]), load_rig(Path(sys.argv[2])), Path(sys.argv[3]))
"""


def test_a_killed_import_leaves_no_run(importer: Importer, tmp_path: Path) -> None:
    """Its partial files are hidden, and removed once they are old."""
    file = tmp_path / "killed.csv"
    file.write_text(STROKES, encoding="utf-8")
    command = [sys.executable, "-c", _KILLED, str(file), str(RIG), str(importer.runs)]
    assert subprocess.run(command, check=False).returncode == 9
    assert list_runs(importer.runs) == []
    left = list(importer.runs.iterdir())
    assert len(left) == 1
    importer.bring_in(STROKES)
    assert left[0].exists()
    os.utime(left[0], (1.0, 1.0))
    importer.bring_in(STROKES)
    assert not left[0].exists()
    assert len(list_runs(importer.runs)) == 2


@pytest.mark.parametrize("more", ["0.03,1,-1,40.6,40.1,40,3\n", "0.00,2,1,40.6,40.1,40,0\n"])
def test_a_file_being_written_is_refused(
    importer: Importer, monkeypatch: pytest.MonkeyPatch, more: str
) -> None:
    from rigctl.dataset.importing import samples
    from rigctl.dataset.recording.writer import RunWriter

    create = RunWriter.create

    def grown(*arguments: Any) -> RunWriter:
        (importer.folder / "strokes.csv").write_text(STROKES + more, encoding="utf-8")
        return create(*arguments)

    monkeypatch.setattr(samples, "_SHORT", 0)
    monkeypatch.setattr(RunWriter, "create", grown)
    assert importer.refusal(STROKES).what == "the file changed while it was read"


def test_two_imports_within_one_second_are_two_runs(importer: Importer) -> None:
    assert importer.bring_in(STROKES).run != importer.bring_in(STROKES).run


def test_imports_of_one_file_at_the_same_time_are_runs_of_their_own(importer: Importer) -> None:
    file = importer.folder / "strokes.csv"
    file.write_text(STROKES, encoding="utf-8")
    start = Barrier(6)

    def bring_in(_: int) -> Path:
        start.wait()
        return import_file(file, importer.rig, importer.runs).path

    with ThreadPoolExecutor(6) as pool:
        folders = list(pool.map(bring_in, range(6)))
    assert len(set(folders)) == 6
    assert [open_run(folder).info["id"] for folder in folders] == [folder.name for folder in folders]


@given(
    rows=st.lists(
        st.tuples(st.floats(0.001, 10.0), st.none() | st.floats(-1e3, 1e3), st.sampled_from([-1, 0, 1])),
        min_size=1,
        max_size=20,
    )
)
@settings(max_examples=25)
def test_an_imported_run_has_the_content_of_its_file(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float | None, int]]
) -> None:
    rig = without_ranges(RIG)
    time, lines = 0.0, ["time [s],position [m],valve"]
    expected = []
    for step, position, valve in rows:
        time += step
        lines.append(f"{time!r},{'' if position is None else repr(position)},{valve}")
        expected.append((time, np.nan if position is None else position, valve))
    run = Importer(tmp_path_factory.mktemp("import"), rig).run("\n".join(lines))
    found = np.column_stack([run.signals(name) for name in ("time", "position", "valve")])
    assert found == pytest.approx(np.array(expected), rel=1e-12, abs=1e-12, nan_ok=True)


def test_readings_outside_the_range_of_their_channel_are_no_values(importer: Importer) -> None:
    """A sentinel of a digital thermometer, and a digit lost by the logger."""
    rows = [
        f"{0.1 * k:.1f},{-127.0 if 20 <= k < 40 else 2020 if k == 50 else 20 + 0.01 * k:.2f},0"
        for k in range(99)
    ]
    imported = importer.bring_in("time [s],oil_temperature [degC],position [mm]\n" + "\n".join(rows) + "\n")
    expected = (
        "21 readings of oil_temperature lie outside its range, -10 degC to 150 degC: they are no values"
    )
    assert expected in imported.notes
    assert not any("are missing" in remark for remark in imported.notes)
    oil = open_run(imported.path).signals("oil_temperature")
    assert np.flatnonzero(np.isnan(oil)).tolist() == [*range(20, 40), 50]


LEVELS = "time [s],oil_temperature [degC],pressure_setpoint [bar]\n"


@pytest.mark.parametrize("written", ["600", "60000", "9.9", "-0.5"])
def test_a_command_beyond_the_limits_of_its_actuator_is_refused(importer: Importer, written: str) -> None:
    """An unknown command is not a missing reading: it decides what every reading means."""
    rows = [f"{k},{40 + 0.1 * k},{written if k == 7 else 20 + 30 * (k % 2)}" for k in range(12)]
    refusal = importer.refusal(LEVELS + "\n".join(rows) + "\n")
    assert isinstance(refusal, SeveralErrors)
    first, last = refusal.errors
    assert (first.where.line, first.value) == (9, f"{float(written):g} bar")
    assert str(first.what) == "relief_valve: beyond the limits of the actuator"
    assert first.expected == "10 bar to 55 bar"
    assert "--missing" in str(last.hint)
    done = importer.bring_in(LEVELS + "\n".join(rows) + "\n", options=Options(missing=(written,)))
    assert np.isnan(open_run(done.path).signals("relief_valve")).sum() == 1
    assert importer.bring_in(LEVELS + "\n".join(rows) + "\n", keep_good=True).left_out == 1


def test_a_command_at_its_limit_may_be_rounded_in_another_unit(importer: Importer) -> None:
    """55 bar is 797.7076 psi."""
    heading = "time [s],oil_temperature [degC],pressure_setpoint [psi]\n"
    rows = [f"{k},{40 + 0.1 * k},{psi}" for k, psi in enumerate([797.71, 400.0] * 6)]
    assert importer.refusal(heading + "\n".join(rows).replace("797.71", "798.5") + "\n")
    done = importer.bring_in(heading + "\n".join(rows) + "\n")
    assert np.nanmax(open_run(done.path).signals("relief_valve")) == pytest.approx(55e5, rel=1e-5)


def test_a_mark_of_a_missing_value_is_no_command(importer: Importer) -> None:
    rows = [f"{k},{40 + 0.1 * k},{-9999 if k == 7 else 20 + 30 * (k % 2)}" for k in range(12)]
    done = importer.bring_in(LEVELS + "\n".join(rows) + "\n")
    assert any("relief_valve: 1 value is -9999, a mark of a missing value" in note for note in done.notes)


def test_a_command_beyond_its_limits_is_refused_in_a_table(importer: Importer) -> None:
    refusal = importer.refusal("pressure_setpoint [bar],position [mm]\n40,80\n4000,80\n60,70\n")
    assert "line 3" in str(refusal) or ":3" in str(refusal)
    assert "beyond the limits of the actuator" in str(refusal)


def test_bad_rows_of_tables_name_their_own_file(importer: Importer, tmp_path: Path) -> None:
    heading = "pressure_setpoint [bar],position [mm]\n"
    files = [tmp_path / "good.csv", tmp_path / "bad.csv"]
    files[0].write_text(heading + "40,80\n50,70\n", "utf-8")
    files[1].write_text(heading + "40,80\n" + "4000,80\n" * (KEPT_FAULTS + 5) + "60,inf\n", "utf-8")
    with pytest.raises(RigctlError) as caught:
        import_files(files, importer.rig, importer.runs, Options())
    first, *_, last = str(caught.value).splitlines()
    assert "bad.csv:3: relief_valve: beyond the limits" in first
    assert f"{KEPT_FAULTS + 6} bad rows" in last
    done = import_files(files, importer.rig, importer.runs, Options(), keep_good=True)
    assert (done.records, done.left_out) == (3, KEPT_FAULTS + 6)


def test_a_mark_among_possible_commands_is_named(importer: Importer, tmp_path: Path) -> None:
    text = importer.rig.text.replace("high: 55 bar", "high: 9e5 bar")
    (tmp_path / "wide.yaml").write_text(text, encoding="utf-8")
    wide = Importer(tmp_path, load_rig(tmp_path / "wide.yaml"))
    rows = [f"{k},{40 + 0.1 * k},{9999 if k == 7 else 20 + 2500 * (k % 2)}" for k in range(12)]
    done = wide.bring_in(LEVELS + "\n".join(rows) + "\n")
    assert any("relief_valve: there is 9999; if that marks a missing value" in note for note in done.notes)


def test_the_ends_of_a_range_are_possible_in_every_unit(importer: Importer) -> None:
    rows = [f"{0.1 * k:.1f},{14 if k % 2 else 302}" for k in range(10)]
    imported = importer.bring_in("time [s],oil_temperature [degF]\n" + "\n".join(rows) + "\n")
    assert not any("outside its range" in remark for remark in imported.notes)


def test_an_impossible_value_of_a_table_is_no_value(importer: Importer) -> None:
    imported = importer.bring_in("oil_temperature [degC],position [mm]\n40,80\n40,8000\n60,70\n")
    assert "1 reading of position lies outside its range, -5 mm to 285 mm: it is no value" in imported.notes
    assert open_run(imported.path).records["position"].isna().tolist() == [False, True, False]


def test_a_sensor_that_sticks_for_a_while_is_named(importer: Importer) -> None:
    noise = np.random.default_rng(3).normal(0.0, 0.06, 300)
    values = np.where(
        (np.arange(300) >= 150) & (np.arange(300) < 185), 33.33, 20.0 + 0.05 * np.arange(300) + noise
    )
    rows = [f"{5 * k},{value:.2f}" for k, value in enumerate(values)]
    imported = importer.bring_in("time [s],oil_temperature [degC]\n" + "\n".join(rows) + "\n")
    assert any(
        "oil_temperature repeats one value exactly, 33.33 degC, from 750 s to 920 s" in remark
        for remark in imported.notes
    )
