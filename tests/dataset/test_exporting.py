from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dataset.strokes import measure_strokes, sample
from rigctl.dataset import Run, RunWriter, open_run
from rigctl.dataset.exporting import export_run
from rigctl.dataset.importing import import_file
from rigctl.errors import RigctlError
from rigctl.rig import load_rig

RIG = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"


@pytest.fixture
def run(make_run: Callable[..., Path]) -> Run:
    return open_run(make_run(records=2, rows=3))


def test_column_headings_include_the_units(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    assert export_run(run, path).rows == 8
    lines = path.read_bytes().decode("utf-8").split("\n")
    assert lines[0] == (
        "time [s],record,oil_temperature [degC],supply_pressure [bar],position [mm],heater [1],valve [1]"
    )
    assert lines[1].startswith("0,-1,40,30,100,1,0")
    assert len(lines) == 10


@pytest.mark.parametrize("name", ["out.csv", "out.parquet"])
def test_exported_files_can_be_imported(run: Run, tmp_path: Path, name: str) -> None:
    export_run(run, tmp_path / name)
    done = import_file(tmp_path / name, load_rig(RIG), tmp_path / "other")
    again = open_run(done.path)
    assert (done.records, done.rows) == (2, 8)
    for column in run.layout.columns:
        assert again.signals(column) == pytest.approx(run.signals(column), rel=1e-14, abs=1e-15)
    assert np.array_equal(again.record(1).time, run.record(1).time)


def test_selected_records_are_exported_and_a_missing_one_is_refused(run: Run, tmp_path: Path) -> None:
    assert export_run(run, tmp_path / "out.csv", records=[1]).rows == 3
    with pytest.raises(RigctlError, match="no such record"):
        export_run(run, tmp_path / "none.csv", records=[7])
    assert not (tmp_path / "none.csv").exists()


def test_missing_values_are_empty_cells(writer: RunWriter, tmp_path: Path) -> None:
    writer.append(sample(0.0, position=float("nan")))
    export_run(open_run(writer.close("finished")), tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()[1] == "0,-1,40,30,,1,0"


@pytest.mark.parametrize(("table", "rows"), [("records", 2), ("events", 10)])
def test_records_and_events_can_be_exported(run: Run, tmp_path: Path, table: str, rows: int) -> None:
    assert export_run(run, tmp_path / "out.csv", table=table).rows == rows
    heading = (tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()[0]
    assert ("oil [degC]" in heading) == (table == "records")


def test_an_existing_file_is_kept(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text("precious", encoding="utf-8")
    with pytest.raises(RigctlError, match="exists already") as caught:
        export_run(run, path)
    assert "--overwrite" in str(caught.value.hint)
    assert path.read_text(encoding="utf-8") == "precious"
    assert export_run(run, path, overwrite=True).rows == 8


def test_missing_tables_and_records_are_reported(run: Run, tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="unknown kind of file"):
        export_run(run, tmp_path / "out.ods")
    with pytest.raises(RigctlError) as caught:
        export_run(run, tmp_path / "out.csv", table="record")
    assert caught.value.nearest == "records"
    with pytest.raises(RigctlError, match="cannot write"):
        export_run(run, tmp_path / "no" / "out.csv")


def test_formula_like_texts_are_disarmed_on_request(writer: RunWriter, tmp_path: Path) -> None:
    measure_strokes(writer, records=1, rows=3)
    for text in ('=HYPERLINK("x")', "+1", "-2", "@SUM(A1)", "plain"):
        writer.event(1.0, "note", message=text)
    run = open_run(writer.close("finished"))
    as_it_is, disarmed = tmp_path / "a.csv", tmp_path / "b.csv"
    assert export_run(run, as_it_is, table="events").disarmed == 0
    assert export_run(run, disarmed, table="events", disarm=True).disarmed == 4

    def messages(path: Path) -> list[str]:
        with path.open(encoding="utf-8", newline="") as file:
            return [row["message"] for row in csv.DictReader(file) if row["kind"] == "note"]

    assert messages(as_it_is) == ['=HYPERLINK("x")', "+1", "-2", "@SUM(A1)", "plain"]
    assert messages(disarmed) == ['\'=HYPERLINK("x")', "'+1", "'-2", "'@SUM(A1)", "plain"]
