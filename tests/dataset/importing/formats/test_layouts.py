"""Text files as programs write them: what stands above a table, headings in the middle, marks, thousands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from open_range import without_ranges
from rigctl.dataset import Run, open_run
from rigctl.dataset.importing import Options, import_file
from rigctl.errors import RigctlError
from rigctl.proposal.columns import read_columns
from rigctl.rig import Rig

BOARD = Path(__file__).parents[4] / "rigs" / "heater-board.yaml"
ROWS = 12
TEMPERATURES = [23.0 + 0.25 * k for k in range(ROWS)]
DUTIES = [0.0 if k < 4 else 60.0 for k in range(ROWS)]


@pytest.fixture(scope="module")
def board() -> Rig:
    return without_ranges(BOARD)


def imported(
    folder: Path, rig: Rig, text: str | bytes, name: str, **options: Any
) -> tuple[Run, tuple[str, ...]]:
    file = folder / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    keep_good = options.pop("keep_good", False)
    done = import_file(file, rig, folder / "runs", options=Options(**options), keep_good=keep_good)
    return open_run(done.path), done.notes


def lines(*parts: str | list[str], end: str = "\n") -> str:
    flat = [line for part in parts for line in ([part] if isinstance(part, str) else part)]
    return end.join([*flat, ""])


def rows(form: str) -> list[str]:
    return [form.format(k=k, t=TEMPERATURES[k], u=DUTIES[k]) for k in range(ROWS)]


LABVIEW = lines(
    *(
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Separator\tTab",
        "Decimal_Separator\t.",
        "Multi_Headings\tNo",
    ),
    *(
        "X_Columns\tOne",
        "Time_Pref\tRelative",
        "Date\t2026/04/11",
        "Time\t13:05:41.25",
        "***End_of_Header***\t",
        "",
    ),
    *("Channels\t2\t\t", "Samples\t12\t12\t", "Date\t2026/04/11\t2026/04/11\t", "Time\t13:05:41\t13:05:41\t"),
    *("Y_Unit_Label\tdegC\t%", "X_Dimension\tTime\tTime\t", "X0\t0.0E+0\t0.0E+0\t", "Delta_X\t1.0\t1.0\t"),
    *("***End_of_Header***\t\t\t", "X_Value\tT\tDuty\tComment"),
    rows("{k}.000000\t{t:.6f}\t{u:.6f}"),
    end="\r\n",
)
CAMPBELL = (
    '"TOA5","bench7","CR1000X","40211","CR1000X.Std.05","CPU:oven.CR1X","5512","Fast"',
    '"TIMESTAMP","RECORD","T","Duty"',
    '"TS","RN","Deg C","%"',
    '"","","Avg","Smp"',
)
GRAPHTEC = lines(
    *('"Vendor","GRAPHTEC Corporation"', '"Model","GL240"', '"Sampling interval","1s"', '"AMP settings"'),
    *(
        '"CH","Signal name","Input","Range","Filter","Span"',
        '"CH1","","TEMP","TC_K","Off",-200.0,1370.0,"degC"',
    ),
    *('"CH2","","DC","10V","Off",-10.0,10.0,"V"', '"Logic/Pulse","Off"', '"Data"'),
    '"Number","Date&Time","ms","CH1","CH2","Alarm1-10","AlarmOut"',
    '"NO.","Time","ms","degC","%","A1234567890","A1234"',
    rows('{k},"2026/06/03 14:00:{k:02}",0,+{t:.2f},+{u:.1f},"LLLLLLLLLL","LLLL"'),
)
#: what the user says about the columns, beside the text
PROGRAMS: dict[str, tuple[str, str | bytes, dict[str, Any]]] = {
    "LabVIEW": ("log.lvm", LABVIEW, {"columns": {"T": "temperature_1", "Duty": "heater_1"}}),
    "Campbell": (
        "log.dat",
        lines(*CAMPBELL, rows('"2026-03-12 09:00:{k:02}",{k},{t:.2f},{u:g}')),
        {"columns": {"T": "temperature_1", "Duty": "heater_1"}},
    ),
    "Campbell, started again": (
        "log.dat",
        lines(
            *CAMPBELL,
            rows('"2026-03-12 09:00:{k:02}",{k},{t:.2f},{u:g}')[:6],
            *CAMPBELL,
            rows('"2026-03-12 09:00:{k:02}",{k},{t:.2f},{u:g}')[6:],
        ),
        {"columns": {"T": "temperature_1", "Duty": "heater_1"}},
    ),
    "BenchVue": (
        "log.csv",
        lines(
            *("Name:,oven,,,,", "Owner:,lab,,,,", "Acquisition Date:,6/3/2026 2:00:00 PM,,,,", ""),
            *(
                "Channel,Name,Function,Range,,",
                "101,Oven,Temp (Type K),C,,",
                "102,Drive,DC voltage,10 V,,",
                "",
            ),
            "Scan,Time,101 (C),Alarm 101,102 (%),Alarm 102",
            rows("{k},06/03/2026 14:00:{k:02}:000,{t:.4f},0,{u:.4f},0"),
        ).encode("utf-16"),
        {
            "dates": "month-first",
            "columns": {
                "101": "temperature_1",
                "102": "heater_1",
                **dict.fromkeys(("Scan", "Alarm 101", "Alarm 102"), "-"),
            },
        },
    ),
    "HOBO": (
        "log.csv",
        lines(
            '\ufeff"Plot Title: oven-7"',
            '"#","Date Time, GMT+02:00","Temp, \u00b0C (LGR S/N: 20717, SEN S/N: 20717, LBL: oven)",'
            '"Duty, %","Coupler Attached (LGR S/N: 20717)","End Of File (LGR S/N: 20717)"',
            rows("{k},06/13/26 02:00:{k:02} PM,{t:.3f},{u:g},,"),
            "13,06/13/26 02:00:12 PM,,,Logged,Logged",
        ),
        {"columns": {"oven": "temperature_1", "Duty": "heater_1"}},
    ),
    "PicoLog": (
        "log.csv",
        lines(
            ",Oven Ave. (\u00b0C),Duty Ave. (%)",
            rows("2026-06-03T14:00:{k:02}+00:00,{t},{u:g}"),
        ),
        {"columns": {"2": "temperature_1", "3": "heater_1"}},
    ),
    "PicoScope": (
        "log.csv",
        lines("Time,Channel A,Channel B", "(ms),(\u00b0C),(%)", "", rows("{k}000.0,{t:.4f},{u:.4f}")),
        {"columns": {"Channel A": "temperature_1", "Channel B": "heater_1"}},
    ),
    "Graphtec": (
        "log.csv",
        GRAPHTEC,
        {"columns": {"CH1": "temperature_1", "CH2": "heater_1", "Number": "-", "ms": "-"}},
    ),
    "pandas": (
        "log.csv",
        lines(",temperature_1 [degC],heater_1 [%]", rows("2026-06-03 14:00:{k:02},{t},{u:g}")),
        {},
    ),
    "Tektronix": (
        "log.csv",
        lines(
            *("Model,MDO34", "Firmware Version,1.20", "", "Point Format,Y,,", "Horizontal Units,S,,"),
            *("Horizontal Scale,0.4,,", "Sample Interval,1.0,,", "Vertical Units,C,%,", "Label,,,", ""),
            "TIME,CH1,CH2",
            rows("{k}.0e+00,{t:.4f},{u:.4f}"),
        ),
        {"columns": {"TIME": "time [s]", "CH1": "temperature_1 [degC]", "CH2": "heater_1 [%]"}},
    ),
    "Tektronix, settings beside the values": (
        "log.csv",
        lines(
            *(
                f'"{name}",{value},,{k}.0,{TEMPERATURES[k]},{DUTIES[k]}'
                for k, (name, value) in enumerate(
                    (("Record Length", "12"), ("Sample Interval", "1.0"), ("Trigger Point", "0"))
                )
            ),
            [f",,,{k}.0,{TEMPERATURES[k]},{DUTIES[k]}" for k in range(3, ROWS)],
        ),
        {
            "heading": 0,
            "columns": {
                "4": "time [s]",
                "5": "temperature_1 [degC]",
                "6": "heater_1 [%]",
                **dict.fromkeys("123", "-"),
            },
        },
    ),
    "no names": (
        "log.asc",
        lines(rows("{k} {t} {u:g}")),
        {"columns": {"1": "time [s]", "2": "temperature_1 [degC]", "3": "heater_1 [%]"}},
    ),
    "a stated heading": (
        "log.csv",
        lines("a;b;c", "1;2;3", "4;5;6", "time [s];temperature_1 [degC];heater_1 [%]", rows("{k};{t};{u:g}")),
        {"heading": 4},
    ),
}


@pytest.mark.parametrize("program", PROGRAMS)
def test_files_are_read_as_the_programs_write_them(tmp_path: Path, board: Rig, program: str) -> None:
    name, text, options = PROGRAMS[program]
    run, _ = imported(tmp_path, board, text, name, **options)
    samples = run.samples()
    good = samples[samples["temperature_1"].notna()]
    assert np.allclose(good["time"], np.arange(ROWS))
    assert np.allclose(good["temperature_1"], TEMPERATURES)
    assert np.allclose(good["heater_1"], DUTIES)
    assert len(run.records) == 1


# --- a heading in the middle

HEAD = "time [s];temperature_1 [degC];temperature_2 [degC]"
FIRST = [f"{k};{40 + k / 8};{23 + k / 8}" for k in range(6)]
SECOND = [f"{k};{40 + k / 8};{23 + k / 8}" for k in range(6, 12)]


@pytest.mark.parametrize("keep_good", [False, True])
@pytest.mark.parametrize(
    "second",
    [
        "time [s];temperature_2 [degC];temperature_1 [degC]",
        "time [s];temperature_1 [degC];Room [degC]",
        "Zeit;Oven",
        "t;a;b;c",
    ],
)
def test_another_heading_in_the_middle_is_refused(
    tmp_path: Path, board: Rig, second: str, keep_good: bool
) -> None:
    text = lines(HEAD, FIRST, second, SECOND)
    with pytest.raises(RigctlError, match="another heading") as caught:
        imported(tmp_path, board, text, "log.csv", keep_good=keep_good)
    assert caught.value.where.line == 8
    assert second.split(";", maxsplit=1)[0] in str(caught.value)
    assert not (tmp_path / "runs").exists() or not [*(tmp_path / "runs").rglob("run.json")]


def test_the_same_heading_again_is_no_row(tmp_path: Path, board: Rig) -> None:
    run, _ = imported(tmp_path, board, lines(HEAD, FIRST, HEAD + ";", SECOND), "log.csv")
    assert len(run.samples()) == 12


def test_a_row_of_errors_is_a_bad_row_and_no_heading(tmp_path: Path, board: Rig) -> None:
    text = lines(HEAD, FIRST, "6;disconnected;disconnected", SECOND[1:])
    with pytest.raises(RigctlError, match=r"log.csv:8:3: temperature_1: not a number.*--missing|keep-good"):
        imported(tmp_path, board, text, "log.csv")
    assert len(imported(tmp_path, board, text, "log.csv", keep_good=True)[0].samples()) == 11


# --- marks in the first cell, and comments


@pytest.mark.parametrize("bad", ["", "x;9;0"])
@pytest.mark.parametrize("mark", ["#DIV/0!", "#N/A", "#NV", "BURNOUT", "+++++", "OVER", "OL"])
def test_a_mark_in_the_first_cell_is_missing_and_not_a_comment(
    tmp_path: Path, board: Rig, mark: str, bad: str
) -> None:
    body = [f"{20.5 + k / 4};{k};0" for k in range(8)]
    text = lines(
        "temperature_1 [degC];time [s];heater_1 [%]", body, f"{mark};8;0", "# a remark", bad or "23.5;9;0"
    )
    run, notes = imported(tmp_path, board, text, "log.csv", keep_good=bool(bad))
    samples = run.samples()
    assert len(samples) == (9 if bad else 10)
    assert int(samples["temperature_1"].isna().sum()) == 1
    assert any(note.startswith("temperature_1: 1 of") for note in notes)


# --- thousands


@pytest.mark.parametrize(
    ("cells", "readings"),
    [
        (("978", "1.011"), None),
        (("978", "-1.011"), None),
        (("0", "1.000"), None),
        (("978.5", "1.011"), (978.5, 1.011)),
        (("0.978", "1.011"), (0.978, 1.011)),
        (("9.780", "1.011"), (9.78, 1.011)),
        (("1500", "1.011"), (1500.0, 1.011)),
        (("1.25", "978"), (1.25, 978.0)),
        (("1e3", "1.011"), (1000.0, 1.011)),
    ],
)
@pytest.mark.parametrize("sign", [".", ","])
@pytest.mark.parametrize("late", [False, True])
def test_a_sign_that_may_separate_thousands_is_put_to_the_user(
    tmp_path: Path, board: Rig, cells: tuple[str, str], readings: Any, sign: str, late: bool
) -> None:
    """Also where it comes up only after the rows that show the form of a file."""
    written = [cell.replace(".", sign) for cell in cells]
    before = ["7"] * 500 if late and readings is None else ["7.5".replace(".", sign)] * 500 if late else []
    text = lines(
        "time [s];temperature_1 [degC];heater_1 [%]",
        [f"{k};{value};50" for k, value in enumerate([*before, *written])],
    )
    if readings is None:
        said = "a decimal sign, or one between thousands"
        if late and sign == ",":  # the first rows have no decimal sign
            said = "expected a number with a decimal point, as in the first rows .--decimal"
        with pytest.raises(RigctlError, match=said) as caught:
            imported(tmp_path, board, text, "log.csv")
        line = next(k for k, row in enumerate(text.splitlines(), start=1) if written[1] in row)
        assert f":{line}" in str(caught.value)
        other = "," if sign == "." else "."
        run, _ = imported(tmp_path, board, text, "log.csv", decimal=other)
        grouped = float(cells[1].replace(".", ""))
        assert run.samples()["temperature_1"].to_numpy()[-1] == pytest.approx(grouped)
        readings = tuple(float(cell) for cell in cells)
        run, _ = imported(tmp_path, board, text, "log.csv", decimal=sign)
    else:
        run, _ = imported(tmp_path, board, text, "log.csv")
    assert run.samples()["temperature_1"].to_numpy()[-2:] == pytest.approx(readings)


def test_a_row_number_is_no_record(tmp_path: Path, board: Rig) -> None:
    text = lines("time [s];RECORD;temperature_1 [degC]", [f"{k};{1000 + k};{23 + k / 8}" for k in range(8)])
    with pytest.raises(RigctlError, match="--columns 'RECORD=-'"):
        imported(tmp_path, board, text, "log.csv")


def table(file: Path, heading: list[str]) -> Path:
    """A file with these rows above the values, as text or as a spreadsheet."""
    text = lines(heading, rows("{k},{t},{u}"))
    if file.suffix == ".csv":
        file.write_text(text, "utf-8")
        return file
    cells = [line.split(",") for line in text.splitlines()]
    typed = [[float(cell) for cell in row] if at >= len(heading) else row for at, row in enumerate(cells)]
    pd.DataFrame(typed).to_excel(file, header=False, index=False)
    return file


@pytest.mark.parametrize("kind", ["csv", "xlsx"])
@pytest.mark.parametrize("again", ["s,degC,%", "[s],[degC],[%]"])
def test_a_row_of_units_that_is_there_twice_is_no_heading(
    tmp_path: Path, board: Rig, kind: str, again: str
) -> None:
    file = table(tmp_path / f"log.{kind}", ["t,temperature_1,heater_1", "s,degC,%", again])
    run = open_run(import_file(file, board, tmp_path / "runs").path)
    assert run.signals("temperature_1") == pytest.approx(np.array(TEMPERATURES) + 273.15)
    assert [column.name for column in read_columns(file, {}).columns] == ["temperature_1", "heater_1"]


@pytest.mark.parametrize("kind", ["csv", "xlsx"])
def test_names_that_are_units_too_are_names_above_other_units(tmp_path: Path, board: Rig, kind: str) -> None:
    file = table(tmp_path / f"log.{kind}", ["bench,seven,eight", "t,T,V", "s,degC,mV"])
    options = Options(columns={"T": "temperature_1", "V": "-"})
    run = open_run(import_file(file, board, tmp_path / "runs", options=options).path)
    assert run.signals("temperature_1")[0] == pytest.approx(TEMPERATURES[0] + 273.15)


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("csv", r"log.csv:3: two rows of units below the names"),
        ("xlsx", r"log.xlsx:3: in sheet 'Sheet1': two rows of units below the names"),
    ],
)
def test_two_rows_of_units_that_differ_are_refused(tmp_path: Path, board: Rig, kind: str, says: str) -> None:
    file = table(tmp_path / f"log.{kind}", ["t,temperature_1,heater_1", "s,degC,%", "s,K,%"])
    with pytest.raises(RigctlError, match=says):
        import_file(file, board, tmp_path / "runs")
