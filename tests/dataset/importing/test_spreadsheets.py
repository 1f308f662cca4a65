"""Typical spreadsheets, written by pandas and by openpyxl."""

from __future__ import annotations

import zipfile
from datetime import UTC, date, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pandas as pd
import pytest

from open_range import without_ranges
from rigctl.dataset import Run, open_run
from rigctl.dataset.importing import Options, import_file, read_table
from rigctl.dataset.importing.formats import formats
from rigctl.errors import RigctlError
from rigctl.rig import Rig, load_rig

BOARD = Path(__file__).parents[3] / "rigs" / "heater-board.yaml"
T1 = "temperature_1 [degC]"


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reader itself; one test runs it apart, as the command does."""
    monkeypatch.setattr(formats, "isolated", False)


@pytest.fixture(scope="module")
def board() -> Rig:
    return load_rig(BOARD)


def run_of(path: Path, rig: Rig, **options: Any) -> Run:
    return open_run(import_file(path, rig, path.parent / "runs", options=Options(**options)).path)


def refusal(path: Path, rig: Rig, **options: Any) -> str:
    with pytest.raises(RigctlError) as caught:
        run_of(path, rig, **options)
    return str(caught.value)


def saved(path: Path, sheets: dict[str, list[list[Any]]]) -> Path:
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in sheets.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    book.save(path)
    return path


def test_a_spreadsheet_written_by_pandas_is_read(
    tmp_path: Path, board: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(formats, "isolated", True)
    stamps = pd.date_range("2026-04-03 12:00", periods=4, freq="500ms")
    frame = pd.DataFrame({"time": stamps, T1: [20.0, np.nan, 21.5, 22.0], "note": list("abcd")})
    frame.to_excel(tmp_path / "log.xlsx", index=False)
    run = run_of(tmp_path / "log.xlsx", board, columns={"note": "-"}, zone="Europe/Berlin")
    assert run.signals("time") == pytest.approx([0.0, 0.5, 1.0, 1.5], abs=1e-6)
    assert run.signals("temperature_1") - 273.15 == pytest.approx([20.0, np.nan, 21.5, 22.0], nan_ok=True)
    assert run.header.started == datetime(2026, 4, 3, 10, tzinfo=UTC)
    assert run.records["name"].tolist() == ["log"]


def test_each_sheet_is_a_record_and_titles_are_skipped(tmp_path: Path, board: Rig) -> None:
    head = [["Heater board, spring", None], [], ["Time", "temperature_1", "Remark"], ["s", "°C", None]]
    path = saved(
        tmp_path / "log.xlsx",
        {
            "Up": [*head, [0, 20, "start"], [1, "---", None], [2, "22.5", None], [], []],
            "Down": [*head, [0, 30, "start"], [1, 29, None]],
            "Notes": [["nothing to see"]],
        },
    )
    run = run_of(path, board, columns={"Remark": "-"})
    assert run.records["name"].tolist() == ["Up", "Down"]
    assert run.record(0).channels["temperature_1"] - 273.15 == pytest.approx(
        [20.0, np.nan, 22.5], nan_ok=True
    )


def test_times_of_day_and_time_spans_are_read_as_times(tmp_path: Path, board: Rig) -> None:
    spans = [[timedelta(seconds=half / 2), 20 + half] for half in range(3)]
    run = run_of(saved(tmp_path / "a.xlsx", {"Log": [["Time", T1], *spans]}), board)
    assert run.signals("time") == pytest.approx([0.0, 0.5, 1.0])
    clocks = [[datetime(2026, 4, 3, 12, 0, second).time(), 20] for second in range(3)]  # noqa: DTZ001
    run = run_of(saved(tmp_path / "b.xlsx", {"Log": [["Time", T1], *clocks]}), board)
    assert np.diff(run.signals("time")) == pytest.approx([1.0, 1.0])


def test_times_are_read_as_in_a_text_file(
    tmp_path: Path, board: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def log(name: str, head: list[str], *rows: list[Any]) -> Path:
        return saved(tmp_path / name, {"Log": [[*head, T1], *([*row, 20] for row in rows)]})

    late, early = time(23, 59, 59), time(0, 0, 1)
    texts = log("iso.xlsx", ["time"], ["2026-04-03T14:00:00"], ["2026-04-03T14:00:00.5"])
    run = run_of(texts, board, zone="Europe/Berlin")
    assert run.header.started == datetime(2026, 4, 3, 12, tzinfo=UTC)
    assert run.signals("time").tolist() == [0.0, 0.5]
    monkeypatch.setattr(formats, "isolated", True)
    run = run_of(log("a.xlsx", ["Date", "Time"], [date(2026, 4, 3), late], [date(2026, 4, 4), early]), board)
    assert run.header.started == datetime(2026, 4, 3, 23, 59, 59, tzinfo=UTC)
    assert run.signals("time").tolist() == [0.0, 2.0]
    monkeypatch.setattr(formats, "isolated", False)
    run = run_of(log("b.xlsx", ["Time"], [late], [early]), board)
    assert np.diff(run.signals("time")).tolist() == [2.0]
    beyond = datetime(1900, 1, 1, 0, 0, 1)  # noqa: DTZ001 - as a time of day past 24 h is stored
    run = run_of(log("c.xlsx", ["Time"], [late], [beyond]), board)
    assert np.diff(run.signals("time")).tolist() == [2.0]
    wrong = log("d.xlsx", ["time"], ["2026-04-03 14:00"], ["noon"], ["2026-04-03 14:01"])
    assert "d.xlsx:3:1: time: not a time, got 'noon'; expected a date and time" in refusal(wrong, board)


def test_times_of_day_under_another_name_are_seconds(tmp_path: Path) -> None:
    rows = [["Uhrzeit", T1], [time(12, 0, 1), 20], [time(12, 0, 2), 21]]
    table = read_table(saved(tmp_path / "log.xlsx", {"Log": rows}))
    assert table.columns[0].values.tolist() == [43201.0, 43202.0]


def test_a_cell_that_is_not_a_number_is_reported_with_its_place(tmp_path: Path, board: Rig) -> None:
    path = saved(tmp_path / "log.xlsx", {"Log": [["time [s]", T1], [0, 20], [1, "warm"], [2, 21], [3, 22]]})
    said = refusal(path, board)
    assert "log.xlsx:3:2: in sheet 'Log': temperature_1: not a number, got 'warm'" in said
    assert np.isnan(run_of(path, board, missing=("warm",)).signals("temperature_1")[1])
    path = saved(tmp_path / "log.xlsx", {"Log": [["time [s]", T1], [0, 20], [2, 21], [1, 22]]})
    assert "log.xlsx:4: in sheet" not in refusal(path, board)
    assert "log.xlsx:4: time: it does not increase" in refusal(path, board)


def test_numbers_stored_as_texts_are_read_as_in_a_text_file(tmp_path: Path, board: Rig) -> None:
    """Some programs write numbers as texts, with the signs of their language."""
    board = without_ranges(BOARD)

    def log(*cells: Any) -> Path:
        rows = [["time [s]", T1], *([float(time), cell] for time, cell in enumerate(cells))]
        return saved(tmp_path / "log.xlsx", {"Log": rows})

    def read(path: Path, **options: Any) -> list[float]:
        return (run_of(path, board, **options).signals("temperature_1") - 273.15).tolist()

    for cells in (("20,5", "21,5", 22), ("20,5", "1.021,5", "22"), ("20,5", "---", 22.5)):
        assert read(log(*cells))[0] == pytest.approx(20.5)
    ambiguous = log(978, "1.011", "1.043")
    said = "log.xlsx:3:2: temperature_1: a decimal sign, or one between thousands?, got '1.011 beside 978'"
    assert said in refusal(ambiguous, board)
    assert read(ambiguous, decimal=".") == pytest.approx([978.0, 1.011, 1.043])
    assert read(ambiguous, decimal=",") == pytest.approx([978.0, 1011.0, 1043.0])
    assert "not a number, got '1,011'" in refusal(log("978.5", "1,011", "979.5"), board)
    assert "not a number, got '436 250'" in refusal(log("434.5", "436 250", 435), board)
    assert read(log("434.5", "436 250", 435), decimal=".")[1] == pytest.approx(436250.0)
    assert read(log("0.978", "1.011", 2)) == pytest.approx([0.978, 1.011, 2.0])
    done = import_file(log("1,234", "2,500", "2,750"), board, tmp_path / "runs")
    assert "numbers such as 1,234 are read with a decimal comma; --decimal . reads thousands" in done.notes


def test_the_row_of_the_heading_may_be_stated(tmp_path: Path, board: Rig) -> None:
    rows = [["oven", "log", "June"], ["Zeit", "Ofen", None], ["s", "degC", None], [0, 20, 1], [1, 21, 2]]
    path = saved(tmp_path / "log.xlsx", {"Log": rows})
    columns = {"Zeit": "time", "Ofen": "temperature_1", "3": "-"}
    assert run_of(path, board, heading=2, columns=columns).signals("time").tolist() == [0.0, 1.0]
    path = saved(tmp_path / "log.xlsx", {"Log": rows[3:]})
    columns = {"1": "time [s]", "2": "temperature_1 [degC]", "3": "-"}
    assert run_of(path, board, heading=0, columns=columns).signals("time").tolist() == [0.0, 1.0]


def test_damaged_and_empty_spreadsheets_are_refused(
    tmp_path: Path, board: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.xlsx"
    path.write_bytes(b"PK\x03\x04 no spreadsheet")
    assert "the file is no XLSX file, or it is damaged" in refusal(path, board)
    assert "there is no table in it" in refusal(saved(path, {"Log": [[1, 2], [3, 4]]}), board)
    monkeypatch.setattr(formats, "isolated", True)
    with zipfile.ZipFile(path) as sound:
        parts = {name: sound.read(name) for name in sound.namelist()}
    entities = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 12))
    bomb = f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY l0 "lol">{entities}]><x>&l11;</x>'
    with zipfile.ZipFile(path, "w") as made:
        for name, content in parts.items():
            made.writestr(name, bomb if name.endswith("sheet1.xml") else content)
    assert "log.xlsx: " in refusal(path, board)


def test_a_cell_merged_over_both_rows_of_a_heading_names_its_column(tmp_path: Path, board: Rig) -> None:
    rows = [
        ["time [s]", "Temperatures", None],
        [None, T1, "temperature_2 [degC]"],
        [0.0, 20, 30],
        [0.5, 21, 31],
    ]
    run = run_of(saved(tmp_path / "merged.xlsx", {"log": rows}), board)
    assert run.signals("time").tolist() == [0.0, 0.5]


def test_a_column_with_values_but_no_name_is_reported(tmp_path: Path, board: Rig) -> None:
    rows = [["time [s]", T1, None], [0.0, 20, 30], [0.5, 21, 31]]
    path = saved(tmp_path / "unnamed.xlsx", {"log": rows})
    done = import_file(path, board, tmp_path / "runs")
    assert "column C of sheet 'log' has no name above its values and is left out" in done.notes


def test_a_sheet_with_two_columns_of_one_name_is_refused(tmp_path: Path, board: Rig) -> None:
    rows = [["time [s]", T1, T1], [0.0, 20, 30], [0.5, 21, 31]]
    said = refusal(saved(tmp_path / "twice.xlsx", {"log": rows}), board)
    assert "the column is there twice, got 'temperature_1'" in said
