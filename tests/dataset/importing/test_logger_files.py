"""Files of loggers and spreadsheets: dates, zones, decimal commas, encodings, marks, headings."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from open_range import without_ranges
from rigctl.dataset import Run, open_run
from rigctl.dataset.importing import Options, import_file, import_files, read_table
from rigctl.dataset.importing.formats.table import PART_ROWS
from rigctl.errors import RigctlError, SeveralErrors
from rigctl.rig import Rig

BOARD = Path(__file__).parents[3] / "rigs" / "heater-board.yaml"
T1 = "temperature_1 [degC]"


@pytest.fixture(scope="module")
def board() -> Rig:
    return without_ranges(BOARD)


class Desk:
    """A folder with a file in it, and the runs that it becomes."""

    def __init__(self, folder: Path, rig: Rig) -> None:
        self.folder, self.rig, self.notes = folder, rig, ()

    def run(self, content: str | bytes, name: str = "log.csv", **options: Any) -> Run:
        file = self.folder / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
        done = import_file(file, self.rig, self.folder / "runs", options=Options(**options))
        self.notes: tuple[str, ...] = done.notes
        return open_run(done.path)

    def refusal(self, content: str | bytes, name: str = "log.csv", **options: Any) -> RigctlError:
        with pytest.raises(RigctlError) as caught:
            self.run(content, name, **options)
        return caught.value


@pytest.fixture
def desk(tmp_path: Path, board: Rig) -> Desk:
    return Desk(tmp_path, board)


# --- times


@pytest.mark.parametrize(
    ("stamps", "options"),
    [
        (("2026-04-03T12:00:00Z", "2026-04-03T12:00:00.5Z"), {}),
        (("2026-04-03 14:00:00+02:00", "2026-04-03 12:00:00.500 UTC"), {}),
        (("20260403T120000", "20260403T120000.5"), {}),
        (("2026/04/03 12:00:00", "2026/04/03 12:00:00.5"), {}),
        (("03.04.2026 12:00", "03.04.2026 12:00:00,5"), {}),
        (("3-Apr-2026 12:00:00", "03-Apr-26 12:00:00.5"), {}),
        (("03/04/2026 12:00:00 PM", "03/04/2026 12:00:00.5 pm"), {"dates": "day-first"}),
        (("04/03/2026 12:00:00", "04/03/2026 12:00:00.5"), {"dates": "month-first"}),
        (("2026-04-03 14:00:00", "2026-04-03 14:00:00.5"), {"zone": "Europe/Berlin"}),
        (("1775217600", "1775217600.5"), {}),
        (("1775217600000", "1775217600500"), {}),
        (("1775217600000000", "1775217600500000"), {}),
        (("1775217600000000000", "1775217600500000000"), {}),
    ],
)
def test_absolute_times_give_the_start_of_the_run(desk: Desk, stamps: tuple[str, str], options: Any) -> None:
    run = desk.run(f"time;{T1}\n{stamps[0]};20\n{stamps[1]};21\n", **options)
    assert run.signals("time").tolist() == [0.0, 0.5]
    assert run.header.started == datetime(2026, 4, 3, 12, tzinfo=UTC)
    ended = datetime.fromisoformat(run.info["ended"])
    assert ended == datetime(2026, 4, 3, 12, 0, 0, 500000, tzinfo=UTC)


def test_epochs_of_spreadsheets_labview_and_matlab_are_recognised(desk: Desk) -> None:
    for unit, count in (("day", "46115.5"), ("s", "3858062400"), ("day", "740075.5")):
        run = desk.run(f"time [{unit}],{T1}\n{count},20\n")
        assert run.header.started == datetime(2026, 4, 3, 12, tzinfo=UTC)


@pytest.mark.parametrize(
    ("unit", "count"),
    [
        ("\N{MICRO SIGN}s", "1775217600000000"),
        ("\N{GREEK SMALL LETTER MU}s", "1775217600000000"),
        ("msec", "1775217600000"),
        ("seconds", "1775217600"),
        ("d", "46115.5"),
    ],
)
def test_epochs_are_recognised_in_other_spellings_of_their_unit(desk: Desk, unit: str, count: str) -> None:
    noon = datetime(2026, 4, 3, 12, tzinfo=UTC)
    assert desk.run(f"time [{unit}],{T1}\n{count},20\n").header.started == noon
    frame = pa.table({f"time [{unit}]": [float(count)], T1: [20.0]})
    pq.write_table(frame, desk.folder / "log.parquet")
    done = import_file(desk.folder / "log.parquet", desk.rig, desk.folder / "runs")
    assert open_run(done.path).header.started == noon


def test_dates_in_their_own_column_and_clocks_passing_midnight_are_read(desk: Desk) -> None:
    rows = "31.12.2025;23:59:59,5;20\n01.01.2026;00:00:00,5;21\n"
    run = desk.run(f"Date;Time;{T1}\n{rows}")
    assert run.signals("time").tolist() == [0.0, 1.0]
    assert run.header.started == datetime(2025, 12, 31, 23, 59, 59, 500000, tzinfo=UTC)
    run = desk.run(f"Time;{T1}\n23:59:59,5;20\n00:00:00,5;21\n")
    assert np.diff(run.signals("time")).tolist() == [1.0]
    run = desk.run(f"Time [min:s];{T1}\n1:30;20\n1:31;21\n")
    assert run.signals("time").tolist() == [90.0, 91.0]


def test_a_repeated_hour_is_resolved_by_the_file_order(desk: Desk) -> None:
    stamps = ["02:30:00", "02:59:59", "02:00:00", "02:30:00", "03:00:00"]
    rows = "".join(f"2026-10-25 {stamp},20\n" for stamp in stamps)
    run = desk.run(f"time,{T1}\n{rows}", zone="Europe/Berlin")
    assert run.signals("time").tolist() == [0.0, 1799.0, 1800.0, 3600.0, 5400.0]


def test_the_repeated_hour_of_a_second_autumn_begins_with_its_first_again(tmp_path: Path) -> None:
    hours = ["01:30", "02:15", "02:45", "02:15", "02:45", "03:15"]
    rows = "".join(f"{day} {hour},20\n" for day in ("2025-10-26", "2026-10-25") for hour in hours)
    (tmp_path / "log.csv").write_text(f"time,{T1}\n{rows}", encoding="utf-8")
    steps = np.diff(read_table(tmp_path / "log.csv", Options(zone="Europe/Berlin")).columns[0].values)
    assert steps[:5].tolist() == steps[6:].tolist() == [2700.0, 1800.0, 1800.0, 1800.0, 1800.0]


def test_rows_slightly_out_of_order_do_not_begin_the_second_hour(tmp_path: Path) -> None:
    rows = "".join(f"2026-10-25 02:10:{second},20\n" for second in ("00", "01", "03", "02", "04"))
    (tmp_path / "log.csv").write_text(f"time,{T1}\n{rows}", encoding="utf-8")
    table = read_table(tmp_path / "log.csv", Options(zone="Europe/Berlin"))
    assert table.columns[0].values.tolist() == [0.0, 1.0, 3.0, 2.0, 4.0]


def test_a_repeated_hour_longer_than_a_part_of_the_file_is_read_whole(tmp_path: Path) -> None:
    first = np.datetime64("2026-10-24T23:59:00", "ns")  # 01:59 in summer, to 03:01 in winter; 20 Hz
    moments = first + np.arange(20 * 7320) * np.timedelta64(50, "ms")
    ends = np.datetime64("2026-10-25T01:00:00", "ns")
    local = moments + np.where(moments < ends, 2, 1) * np.timedelta64(1, "h")
    pq.write_table(pa.table({"time": local, T1: np.full(len(local), 20.0)}), tmp_path / "log.parquet")
    texts = np.datetime_as_string(local, unit="ms")
    (tmp_path / "log.csv").write_text(f"time,{T1}\n" + "".join(f"{text},20\n" for text in texts))
    assert len(local) > PART_ROWS
    for name in ("log.parquet", "log.csv"):
        table = read_table(tmp_path / name, Options(zone="Europe/Berlin"))
        assert np.abs(table.columns[0].values - 0.05 * np.arange(len(local))).max() < 1e-6


@pytest.mark.parametrize(
    ("cell", "options", "said"),
    [
        (
            "03/04/2026 12:00",
            {},
            "day and month cannot be told apart, got '03/04/2026 12:00'; expected --dates",
        ),
        ("13/04/2026", {"dates": "month-first"}, "month-first does not fit"),
        ("03/04/2026", {"dates": "iso"}, "not an ISO date"),
        ("12:30", {}, "hours and minutes, or minutes and seconds?"),
        ("yesterday", {}, "neither numbers nor dates"),
        ("2026-04-03 12:00", {"zone": "Europe/Berln"}, "did you mean 'Europe/Berlin'?"),
    ],
)
def test_ambiguous_times_need_an_option(desk: Desk, cell: str, options: Any, said: str) -> None:
    problem = desk.refusal(f"# logger\ntime,{T1}\n{cell},20\n", **options)
    assert said in str(problem)


def test_an_invalid_time_is_reported_by_line(desk: Desk) -> None:
    rows = ["2026-04-03 12:00:00,20", "2026-04-31 12:00:01,20", "noon,20", "2026-04-03 12:00:03,20"]
    problem = desk.refusal(f"time,{T1}\n" + "\n".join(rows) + "\n")
    assert isinstance(problem, SeveralErrors)
    told = [(error.where.line, error.what, error.value) for error in problem.errors[:-1]]
    assert told == [
        (3, "time: not a time", "2026-04-31 12:00:01"),
        (4, "time: not a time", "noon"),
    ]
    assert problem.errors[0].expected == "a date and time such as 2026-03-21 14:05:30"


def test_assumptions_are_reported(desk: Desk) -> None:
    desk.run(f"time,{T1}\n2026-04-03 12:00:00,20\n")
    assert "its times name no time zone; they are taken as UTC (--zone says otherwise)" in desk.notes


#: date formats of `strftime`, and the options needed to read them
FORMATS = {
    "%Y-%m-%dT%H:%M:%S.%fZ": {},
    "%Y-%m-%d %H:%M:%S.%f": {},
    "%d.%m.%Y %H:%M:%S,%f": {},
    "%d/%m/%Y %H:%M:%S.%f": {"dates": "day-first"},
    "%m/%d/%Y %I:%M:%S.%f %p": {"dates": "month-first"},
    "%d-%b-%Y %H:%M:%S.%f": {},
}


@given(
    start=st.datetimes(datetime(1995, 1, 1), datetime(2060, 1, 1)),  # noqa: DTZ001
    steps=st.lists(st.integers(1, 10**9), min_size=1, max_size=12),
    form=st.sampled_from(sorted(FORMATS)),
    delimiter=st.sampled_from([";", "\t", "|"]),
    comma=st.booleans(),
)
@settings(max_examples=40)
def test_any_date_in_any_format_is_read_correctly(
    tmp_path_factory: pytest.TempPathFactory,
    board: Rig,
    start: datetime,
    steps: list[int],
    form: str,
    delimiter: str,
    comma: bool,
) -> None:
    """Dates, delimiters and decimal signs in any combination; written by `strftime`, and not by us."""
    moments = [start]
    for step in steps:
        moments.append(moments[-1] + timedelta(microseconds=step))
    values = [20.0 + 0.25 * place for place in range(len(moments))]
    lines = [delimiter.join(("time", T1))]
    for moment, value in zip(moments, values, strict=True):
        cell = repr(value).replace(".", ",") if comma else repr(value)
        lines.append(delimiter.join((moment.strftime(form), cell)))
    run = Desk(tmp_path_factory.mktemp("dates"), board).run("\n".join(lines), **FORMATS[form])
    assert run.header.started == start.replace(tzinfo=UTC)
    expected = [(moment - start).total_seconds() for moment in moments]
    assert run.signals("time") == pytest.approx(expected, abs=1e-9)
    assert run.signals("temperature_1") - 273.15 == pytest.approx(values, abs=1e-9)


# --- numbers and marks


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_every_encoding_and_line_ending_is_read(desk: Desk, encoding: str, end: str) -> None:
    lines = ["Zeit [s];Temperatur (°C);Bemerkung", "0;20,5;über", "1;21,5;", ""]
    columns = {"Zeit": "time", "Temperatur": "temperature_1", "Bemerkung": "-"}
    run = desk.run(end.join(lines).encode(encoding), columns=columns)
    assert run.signals("temperature_1") - 273.15 == pytest.approx([20.5, 21.5])


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (("20,5", "1.020,5"), (20.5, 1020.5)),
        (("20.5", "1,020.5"), (20.5, 1020.5)),
        (("20.5", "1'020.5"), (20.5, 1020.5)),
        (("2,05E1", "-3,1e-1"), (20.5, -0.31)),
    ],
)
def test_decimal_signs_and_thousands_separators_are_recognised(
    desk: Desk, cells: tuple[str, str], expected: tuple[float, float]
) -> None:
    run = desk.run(f"time [s];{T1}\n0;{cells[0]}\n1;{cells[1]}\n")
    assert run.signals("temperature_1") - 273.15 == pytest.approx(expected)


def test_numbers_with_the_other_decimal_sign_are_refused(desk: Desk) -> None:
    problem = desk.refusal(f"time [s];{T1}\n0;20,5\n1;21,5\n2;1.020\n")
    assert (problem.where.line, problem.where.column) == (4, 3)
    assert "expected a number with a decimal comma" in str(problem)


@pytest.mark.parametrize("sign", [" ", "'", "\N{NO-BREAK SPACE}", "\N{NARROW NO-BREAK SPACE}"])
def test_a_whole_number_in_groups_among_fractions_is_read_only_if_the_decimal_sign_is_given(
    desk: Desk, sign: str
) -> None:
    """The sign between its digits may have been typed instead of the point."""
    text = f"time [s];{T1}\n0;434.5\n1;436{sign}250\n2;437.5\n"
    problem = desk.refusal(text)
    assert (problem.where.line, problem.where.column) == (3, 3)
    expected = "expected a number with a decimal point, as in the first rows, or --decimal '.' (436250)"
    assert expected in str(problem)
    run = desk.run(text, decimal=".")
    assert run.signals("temperature_1") - 273.15 == pytest.approx([434.5, 436250.0, 437.5])
    whole = f"time [s];{T1}\n0;434\n1;1{sign}250\n2;437\n"  # without fractions there is only one reading
    assert desk.run(whole).signals("temperature_1") - 273.15 == pytest.approx([434.0, 1250.0, 437.0])


def test_thousands_separators_are_read_when_the_decimal_sign_is_given(desk: Desk) -> None:
    text = f"time [s];{T1}\n0;1,234\n1;2,500\n"
    assert desk.run(text).signals("temperature_1") - 273.15 == pytest.approx([1.234, 2.5])
    assert "numbers such as 1,234 are read with a decimal comma; --decimal . reads thousands" in desk.notes
    assert desk.run(text, decimal=".").signals("temperature_1") - 273.15 == pytest.approx([1234.0, 2500.0])


def test_a_number_that_may_mark_a_missing_value_is_reported(desk: Desk) -> None:
    desk.run(f"time [s],{T1}\n0,-999\n1,-300\n2,-220\n3,20\n")
    assert "temperature_1: there is -999; if that marks a missing value, say so: --missing=-999" in desk.notes


def test_lines_that_are_not_rows_are_skipped(desk: Desk) -> None:
    run = desk.run(f"\n\ntime [s];{T1}\n0;20,5\n\n1;21,5\n")
    assert run.signals("time").tolist() == [0.0, 1.0]
    run = desk.run(f"sep=;\ntime [s];{T1}\n0;20,5\n# paused\n1;21,5\n# end\n")
    assert run.signals("temperature_1") - 273.15 == pytest.approx([20.5, 21.5])


def test_common_and_given_marks_of_missing_values_are_read_as_missing(desk: Desk) -> None:
    marks = ["", "NaN", "---", "OL", "OVLD", "#N/A", "9.9E+37", "-9999", "-9999.0", "dead"]
    rows = "".join(f"{time},{mark}\n" for time, mark in enumerate([*marks, "20"]))
    run = desk.run(f"time [s],{T1}\n{rows}", missing=("-9999", "dead"))
    assert np.isnan(run.signals("temperature_1")).tolist() == [True] * len(marks) + [False]


def test_headings_in_the_layouts_of_other_programs_are_read(desk: Desk) -> None:
    # PicoScope: units in a separate row
    run = desk.run("Time,Temperature 1\n(ms),(degC)\n\n0,20\n100,21\n")
    assert run.signals("time").tolist() == [0.0, 0.1]
    assert run.layout.channels == ("temperature_1",)
    # a preamble before the table, and rows that end with a delimiter
    head = "Logger 7;SN 12\nStarted;03.04.2026\n\n"
    run = desk.run(f"{head}Time / s;temperature_1 in degC;\n0;20;\n1;21;\n")
    assert run.signals("temperature_1") - 273.15 == pytest.approx([20.0, 21.0])
    assert any("before the heading" in note for note in desk.notes)
    # notes padded by a spreadsheet to the width of the table, and units in a separate row
    head = "Logger 7;SN 12;\n\nBy;;\n"
    run = desk.run(f"{head}Time;temperature_1;temperature_2\n[s];[degC];[degC]\n0;20;30\n1;21;31\n")
    assert run.signals("temperature_2") - 273.15 == pytest.approx([30.0, 31.0])
    assert any("2 lines before the heading, on line 4" in note for note in desk.notes)
    # a merged heading in two rows
    run = desk.run(f"time [s],Board,\n,{T1},temperature_2 [degC]\n0,20,30\n1,21,31\n")
    assert run.layout.channels == ("temperature_1", "temperature_2")
    # numpy.savetxt with a header
    run = desk.run(f"# time [s], {T1}\n0.0,20.0\n1.0,21.0\n")
    assert run.signals("time").tolist() == [0.0, 1.0]
    # laid out with spaces
    run = desk.run(f"time [s]   {T1}\n  0.0     20.0\n 10.5     21.0\n")
    assert run.signals("time").tolist() == [0.0, 10.5]
    # a line break in a quoted heading, as spreadsheets write it
    run = desk.run('"time\n[s]","temperature_1\n[degC]"\n0,20\n1,21\n')
    assert run.signals("time").tolist() == [0.0, 1.0]
    # no heading at all: columns by their numbers
    run = desk.run("0,20\n1,21\n", columns={"1": "time [s]", "2": T1})
    assert run.signals("temperature_1") - 273.15 == pytest.approx([20.0, 21.0])


def test_csv_and_parquet_files_written_by_pandas_are_read(desk: Desk) -> None:
    stamps = pd.date_range("2026-04-03 12:00", periods=5, freq="250ms", tz="Europe/Berlin")
    frame = pd.DataFrame({"time": stamps, T1: [20.0, np.nan, 21.5, 22.0, 22.5]})
    frame.to_csv(desk.folder / "frame.csv", index=False)
    frame.to_csv(desk.folder / "german.csv", index=False, sep=";", decimal=",", encoding="utf-16")
    frame.to_parquet(desk.folder / "frame.parquet")
    for name in ("frame.csv", "german.csv", "frame.parquet"):
        run = desk.run((desk.folder / name).read_bytes(), name)
        assert run.signals("time").tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
        assert run.header.started == datetime(2026, 4, 3, 10, tzinfo=UTC)
        assert run.signals("temperature_1")[2] == pytest.approx(294.65)


# --- several files, what is assumed, what is suggested


def test_several_files_become_one_run_with_a_record_each(desk: Desk) -> None:
    for day, name in ((3, "mon"), (4, "tue")):
        rows = "".join(f"2026-04-{day:02d} 12:00:0{second},{20 + day}\n" for second in range(3))
        (desk.folder / f"{name}.csv").write_text(f"time,{T1}\n{rows}", encoding="utf-8")
    (desk.folder / "wed.csv").write_text(
        f"when,heater_1 [%],{T1}\n2026-04-05T12:00:00Z,50,30\n2026-04-05T12:00:01Z,50,30\n", encoding="utf-8"
    )
    paths = [desk.folder / f"{name}.csv" for name in ("mon", "tue", "wed")]
    options = Options(columns={"when": "time"})
    run = open_run(import_files(paths, desk.rig, desk.folder / "runs", options).path)
    assert run.records["name"].tolist() == ["mon", "tue", "wed"]
    assert run.record(1).time.tolist() == [86400.0, 86401.0, 86402.0]
    assert np.isnan(run.record(0).commands["heater_1"]).all()
    assert run.record(2).commands["heater_1"].tolist() == [0.5, 0.5]
    assert run.header.started == datetime(2026, 4, 3, 12, tzinfo=UTC)
    (desk.folder / "tue.csv").write_text(f"time,{T1}\n2026-04-04 12:00:00,21\n12,21\n", encoding="utf-8")
    with pytest.raises(RigctlError, match=r"tue\.csv:3: time: not a time"):
        import_files(paths, desk.rig, desk.folder / "runs", options)


def test_assumptions_are_kept_with_the_run(desk: Desk) -> None:
    text = f"time [s],{T1}\n0,20\n1,21\n"
    run = desk.run(text, assume={"heater_1": "0", "ambient_temperature": "21 degC", "heater_2": "30 %"})
    assert run.info["assumed"] == pytest.approx(
        {"heater_1": 0.0, "ambient_temperature": 294.15, "heater_2": 0.3}
    )
    assert run.header.assumed == run.info["assumed"]
    assert "assumed: heater_2 30 %, throughout" in desk.notes
    for assume, said in (
        ({"heater_3": "0"}, "did you mean 'heater_"),
        ({"temperature_1": "20 degC"}, "temperature_1 is in the file"),
        ({"heater_2": "20 bar"}, "heater_2: wrong dimension"),
        ({"ambient_temperature": "21"}, "ambient_temperature: the unit is missing"),
        ({"ambient_temperature": "21"}, "21 degC"),
        ({"wind": "3"}, "wind: the unit is missing"),
    ):
        assert said in str(desk.refusal(text, assume=assume))


def test_suggested_names_belong_to_this_bench_and_have_the_same_dimension(desk: Desk) -> None:
    problem = desk.refusal("time [s],supply_presure [bar]\n0,1\n")
    assert problem.nearest is None
    assert "supply_pressure" not in str(problem)
    problem = desk.refusal(f"time [s],heater_1 [%],heater_2 [%],{T1},probe [degC]\n0,0,0,20,20\n")
    assert problem.nearest == "temperature_2"
    problem = desk.refusal("Moment,temperature1 [degC],heatr [bar]\n0,1,2\n")
    assert "Moment=time" in str(problem)
    problem = desk.refusal("time [s],temperature1 [degC],heater_l [bar]\n0,1,2\n")
    assert "temperature1=temperature_1,heater_l=-" in str(problem)


def test_a_table_is_read_without_a_bench(desk: Desk) -> None:
    path = desk.folder / "motor.csv"
    path.write_text(
        "Uhrzeit;Strom (A);Drehzahl [rpm];Kommentar\n12:00:00,0;0,5;100;an\n12:00:00,1;;110;\n",
        encoding="cp1252",
    )
    table = read_table(path, Options(columns={"Uhrzeit": "time"}))
    assert [(column.name, column.unit) for column in table.columns] == [
        ("Uhrzeit", "s"), ("Strom", "A"), ("Drehzahl", "rpm")
    ]  # fmt: skip
    assert (table.time, table.origin, table.texts) == (0, None, ("Kommentar",))
    assert np.diff(table.columns[0].values) == pytest.approx([0.1])
    assert np.isnan(table.columns[1].values).tolist() == [False, True]


# --- times that do not go on, and records


def rows_of(times: list[Any], start: int = 20) -> str:
    return f"time [s],{T1}\n" + "".join(f"{time},{start + k}\n" for k, time in enumerate(times))


def test_times_that_do_not_increase_are_refused_dropped_spread_or_split_as_chosen(desk: Desk) -> None:
    text = rows_of([0, 1, 1, 2, 3, 1, 4])
    problem = desk.refusal(text)
    assert isinstance(problem, SeveralErrors)
    assert [error.where.line for error in problem.errors[:-1]] == [4, 7]
    run = desk.run(text, times="drop")
    assert run.signals("time").tolist() == [0, 1, 2, 3, 4]
    assert "2 rows whose time does not increase were dropped, the first of them on line 4" in desk.notes
    run = desk.run(rows_of([0, 0, 1, 1, 2, 2]), times="spread")
    assert run.signals("time").tolist() == [0, 0.5, 1, 1.5, 2, 2.5]
    run = desk.run(rows_of([0, 0, 1, 1, 2, 2, 1000, 1000, 1001, 1001]), times="spread")  # with a pause
    assert run.signals("time").tolist() == [0, 0.5, 1, 1.5, 2, 2.5, 1000, 1000.5, 1001, 1001.5]
    run = desk.run(rows_of([0, 1, 2, 0, 1, 5, 6]), times="split")
    assert run.signals("record").tolist() == [0, 0, 0, 1, 1, 1, 1]


@given(rate=st.integers(2, 20), seconds=st.integers(2, 8), cut=st.integers(0, 19))
@settings(max_examples=20)
def test_times_in_whole_seconds_are_spread_at_the_sampling_rate(
    tmp_path_factory: pytest.TempPathFactory, board: Rig, rate: int, seconds: int, cut: int
) -> None:
    times = [k // rate for k in range(rate * seconds + cut % rate)]
    run = Desk(tmp_path_factory.mktemp("spread"), board).run(rows_of(times), times="spread")
    found = run.signals("time")
    assert len(found) == len(times)
    assert np.diff(found)[: rate * (seconds - 1)] == pytest.approx(1.0 / rate)
    assert (np.diff(found) > 0).all()


def test_records_split_at_commands_begin_before_the_command(desk: Desk) -> None:
    heater = [0] * 20 + [50] * 10 + [0] * 30 + [80] * 10 + [0] * 4 + [30] * 5
    lines = [f"time [s],heater_1 [%],{T1}", *(f"{t},{u},{20 + t}" for t, u in enumerate(heater))]
    run = desk.run("\n".join(lines), split="command")
    assert run.records["start"].tolist() == [0.0, 50.0, 72.0]
    second = run.record(1)
    assert [(switch.time, switch.value) for switch in second.switches] == [(59.5, 0.8), (69.5, 0.0)]
    assert second.commands["heater_1"][0] == 0.0
    assert len(desk.run("\n".join(lines), split="command:heater_1").usable) == 3
    assert "did you mean 'heater_1'" in str(desk.refusal("\n".join(lines), split="command:heater_2"))
    assert "the file has no command" in str(desk.refusal(rows_of([0, 1]), split="command"))


def test_records_can_be_split_at_gaps_or_by_a_column(desk: Desk) -> None:
    run = desk.run(rows_of([0, 1, 2, 100, 101, 102, 103, 0, 1]), split="gap")
    assert run.records["start"].tolist() == [0.0, 100.0, 0.0]
    run = desk.run(rows_of([0, 1, 2, 5, 6, 100]), split="gap:2 s")
    assert len(run.usable) == 3
    phases = ["warm", "warm", "cold", "cold", "warm"]
    text = f"time [s],Phase,heater_1 [%],{T1}\n" + "".join(
        f"{t},{p},{t // 2},20\n" for t, p in enumerate(phases)
    )
    run = desk.run(text, split="column:Phase")
    assert run.records["name"].tolist() == ["warm", "cold", "warm (2)"]
    run = desk.run(text, split="column:heater_1", columns={"Phase": "-"})
    assert run.records["name"].tolist() == ["heater_1=0", "heater_1=1", "heater_1=2"]
    assert np.isclose(run.record(1).commands["heater_1"], 0.01).all()
    assert "unknown column to split by" in str(
        desk.refusal(text, split="column:phases", columns={"Phase": "-"})
    )
    assert "no such way" in str(desk.refusal(text, split="commands", columns={"Phase": "-"}))


def test_the_time_of_a_switch_lies_between_two_samples_with_different_commands(desk: Desk) -> None:
    """In (t_{k-1}, t_k]: also for the first two samples, and across a sample without a command value."""
    cells = ["0", "50", "50", "", "0"]
    text = f"time [s],heater_1 [%],{T1}\n" + "".join(f"{t},{u},20\n" for t, u in enumerate(cells))
    found = [
        (s.time - s.uncertainty, s.time + s.uncertainty, s.value) for s in desk.run(text).record(0).switches
    ]
    assert found == [(0.0, 1.0, 0.5), (2.0, 4.0, 0.0)]
