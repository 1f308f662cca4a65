"""Export and import of every format with the commands."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from commands import answer, refusal
from rigctl.dataset import Run, open_run
from rigctl.dataset.importing.formats import formats, groups

ENDINGS = ["csv", "parquet", "tdms", "mf4", "mat", "xlsx"]
RIG = ["--rig", "rigs/hl32-bench.yaml"]


@pytest.fixture
def strokes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A run with rows between records, a missing value, and records without names of their own."""
    monkeypatch.chdir(tmp_path)
    rows = ["time [s],record,valve [1],oil_temperature [degC],pressure_setpoint [bar],position [mm]"]
    for place, record in enumerate(("-1", "0", "1", "-1", "2")):
        for step in range(30):
            time = place * 10 + step * 0.01
            position = "" if step == 4 else f"{0.1 * step * step + place}"
            rows.append(f"{time:.2f},{record},{int(step > 12)},{40 + place},{30},{position}")
    Path("strokes.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return open_run(answer("import", "strokes.csv", *RIG)["path"])


def same_samples(run: Run, other: Run) -> None:
    assert other.layout.columns == run.layout.columns
    assert other.layout.units == run.layout.units
    for name in run.layout.columns:
        assert other.signals(name) == pytest.approx(run.signals(name), rel=1e-14, abs=1e-12, nan_ok=True)
    assert [s.time for s in other.switches] == pytest.approx([s.time for s in run.switches])


@pytest.mark.parametrize("ending", ENDINGS)
def test_samples_round_trip_unchanged(strokes: Run, ending: str) -> None:
    done = answer("export", strokes.id, "-o", f"out.{ending}")
    assert (done["rows"], done["table"]) == (150, "samples")
    again = answer("import", f"out.{ending}", *RIG)
    assert (again["records"], again["rows"], again["left_out"]) == (3, 150, 0)
    same_samples(strokes, open_run(again["path"]))


def test_an_mdf_file_has_the_start_time_of_the_measurement(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from asammdf import MDF

    monkeypatch.setattr(formats, "isolated", False)
    Path("log.csv").write_text("time,position [mm]\n2020-05-01T12:00:00Z,1\n2020-05-01T12:00:01Z,2\n")
    first = answer("import", "log.csv", *RIG)
    answer("export", first["run"], "-o", "out.mf4")
    with MDF("out.mf4") as made:
        assert made.header.start_time.timestamp() == 1588334400.0
    again = open_run(answer("import", "out.mf4", *RIG)["path"])
    assert again.header.started == open_run(first["path"]).header.started
    assert again.record(0).time.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("ending", ["tdms", "mf4"])
def test_a_large_file_is_read_in_pieces(strokes: Run, ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(formats, "isolated", False)
    module = import_module(f"rigctl.dataset.importing.formats.{'mdf' if ending == 'mf4' else ending}_file")
    monkeypatch.setattr(module, "LARGE", 0)
    monkeypatch.setattr(groups, "PART_ROWS", 7)
    answer("export", strokes.id, "-o", f"out.{ending}")
    same_samples(strokes, open_run(answer("import", f"out.{ending}", *RIG)["path"]))


@pytest.mark.parametrize("ending", ["tdms", "mf4", "mat", "xlsx"])
def test_records_keep_their_names_where_a_format_has_names(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(formats, "isolated", False)
    path = tmp_path / "steps.csv"
    rows = ["time [s],record,heater_1 [%],temperature_1 [degC]"]
    rows += [f"{t},{name},50,{20 + t}" for name in ("up", "down") for t in range(12)]
    path.write_text("\n".join(rows), encoding="utf-8")
    board = ["--rig", "rigs/heater-board.yaml"]
    first = answer("import", str(path), *board)
    answer("export", first["run"], "-o", str(tmp_path / f"out.{ending}"))
    again = open_run(answer("import", str(tmp_path / f"out.{ending}"), *board)["path"])
    assert again.records["name"].tolist() == ["up", "down"]
    same_samples(open_run(first["path"]), again)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("ending", ["csv", "parquet", "tdms", "mat", "xlsx"])
def test_observations_round_trip_unchanged(ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(formats, "isolated", False)
    first = answer("import", "data/hl32-strokes.csv", *RIG)
    done = answer("export", first["run"], "-o", f"out.{ending}")
    assert (done["rows"], done["table"]) == (8, "observations")
    again = open_run(answer("import", f"out.{ending}", *RIG)["path"])
    run = open_run(first["path"])
    assert len(again.usable) == 8
    for index in run.usable:
        before, after = run.record(index), again.record(index)
        assert dict(after.sweep) == pytest.approx(dict(before.sweep))
        assert dict(after.measures) == pytest.approx(dict(before.measures))


@pytest.mark.parametrize("ending", ["csv", "parquet", "tdms", "mat", "xlsx"])
@pytest.mark.parametrize(("table", "rows"), [("records", 3), ("events", None)])
def test_records_and_events_are_exported_too(strokes: Run, ending: str, table: str, rows: int | None) -> None:
    done = answer("export", strokes.id, "--table", table, "-o", f"out.{ending}")
    assert done["rows"] == (rows if rows is not None else len(strokes.events))


def test_units_are_stored_where_each_format_keeps_them(strokes: Run) -> None:
    from asammdf import MDF
    from nptdms import TdmsFile
    from scipy.io import loadmat

    for ending in ("tdms", "mf4", "mat"):
        answer("export", strokes.id, "-o", f"out.{ending}")
    tdms = TdmsFile.read("out.tdms")
    assert [group.name for group in tdms.groups()] == [
        "between records, 0", "strokes 0", "strokes 1", "between records, 3", "strokes 2"
    ]  # fmt: skip
    assert tdms["strokes 1"]["position"].properties["unit_string"] == "mm"
    with MDF("out.mf4") as mdf:
        signal = mdf.get("position", group=1)
        assert (signal.unit, len(signal.samples)) == ("mm", 30)
        assert signal.timestamps[1] == pytest.approx(10.01)
    mat = loadmat("out.mat", squeeze_me=True, struct_as_record=False)
    assert mat["units"].position == "mm"
    assert [piece.name for piece in mat["data"]][1] == "strokes 0"
    assert np.isnan(mat["data"][1].position[4])


def test_pandas_and_openpyxl_read_exported_files(strokes: Run) -> None:
    import openpyxl
    import pandas as pd

    for ending in ("csv", "parquet", "xlsx"):
        answer("export", strokes.id, "-o", f"out.{ending}")
    for frame in (pd.read_csv("out.csv"), pd.read_parquet("out.parquet")):
        assert frame["position [mm]"][31] == pytest.approx(strokes.signals("position")[31] * 1e3)
        assert frame["position [mm]"].isna().sum() == 5
    book = openpyxl.load_workbook("out.xlsx")
    assert book.sheetnames[:2] == ["between records, 0", "strokes 0"]
    assert [cell.value for cell in book["strokes 1"][1]][:2] == ["time [s]", "oil_temperature [degC]"]
    sheet = pd.read_excel("out.xlsx", sheet_name="strokes 2")
    assert sheet["position [mm]"].isna().tolist() == [step == 4 for step in range(30)]


def test_mdf_holds_samples_only(strokes: Run) -> None:
    said = refusal("export", strokes.id, "--table", "events", "-o", "out.mf4")
    assert "an MDF file holds samples" in said
    assert not Path("out.mf4").exists()


@pytest.mark.parametrize("ending", ENDINGS)
def test_bad_rows_are_reported_and_can_be_left_out(
    ending: str, strokes: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Time goes back in the second record: nothing is imported, or everything except that row."""
    monkeypatch.setattr(formats, "isolated", False)
    text = Path("strokes.csv").read_text(encoding="utf-8").replace("\n20.05,", "\n20.03,", 1)
    Path("bad.csv").write_text(text, encoding="utf-8")
    if ending != "csv":
        convert(Path("bad.csv"), Path(f"bad.{ending}"))
    runs = len(list(Path("runs").iterdir()))
    said = refusal("import", f"bad.{ending}", *RIG)
    assert "time: it does not increase within a record, got '20.03 s'" in said
    assert "1 bad row" in said
    assert len(list(Path("runs").iterdir())) == runs
    done = answer("import", f"bad.{ending}", *RIG, "--keep-good")
    assert (done["records"], done["rows"], done["left_out"]) == (3, 149, 1)


def convert(source: Path, target: Path) -> None:
    """A file of samples in another format, whatever is wrong with its rows."""
    import pandas as pd
    import pyarrow as pa

    from rigctl.dataset.exporting import export

    frame = pd.read_csv(source)
    frame["record"] = frame["record"].astype("int32")
    fields = []
    for name in frame.columns:
        plain, _, unit = name.partition(" [")
        fields.append(
            pa.field(plain, pa.int32() if plain == "record" else pa.float64(), metadata={"unit": unit[:-1]})
        )
    table = pa.table(
        [pa.array(frame[c]).cast(f.type) for c, f in zip(frame.columns, fields, strict=True)],
        pa.schema(fields),
    )
    module = __import__(f"rigctl.dataset.exporting.{export.FORMATS[target.suffix]}", fromlist=["write"])
    module.write(target, table, ["a", "b", "c"], "samples")
