"""Headings of other programs: which column is the time, and units in names, read alike by every command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rigctl.dataset import open_run
from rigctl.dataset.importing import Options, import_file
from rigctl.dataset.importing.cells.headings import split_heading, time_unit
from rigctl.errors import RigctlError
from rigctl.proposal.columns import read_columns
from rigctl.rig import Rig, load_rig

MOTOR = """\
name: motor
channels:
  speed: {unit: rpm, quantity: angular_speed}
actuators:
  voltage: {kind: level, unit: V, low: 0 V, high: 12 V}
safe_state: {voltage: 0 V}
"""


@pytest.fixture
def motor(tmp_path: Path) -> Rig:
    (tmp_path / "motor.yaml").write_text(MOTOR, encoding="utf-8")
    return load_rig(tmp_path / "motor.yaml")


def log(path: Path, heading: str, *, scale: float = 1.0, rows: int = 12) -> Path:
    lines = [f"{0.5 * k * scale:g},{6.0 if k > 3 else 0.0},{100.0 + k}" for k in range(rows)]
    path.write_text("\n".join([heading, *lines]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("heading", "scale"),
    [
        ("time_s,voltage_V,speed_rpm", 1.0),
        ("Time,Voltage [V],Speed [rpm]", 1.0),
        ("t [s],voltage (V),Speed (rpm)", 1.0),
        ("t/ms,Voltage/V,speed/rpm", 1000.0),
        ("Tiempo (ms),VOLTAGE_V,Speed_RPM", 1000.0),
        ("Zeit_ms,voltage_V,Speed [1/min]", 1000.0),
        ("temps,Voltage / V,speed in rpm", 1.0),
        ("tempo [min],voltage; V,speed {rpm}", 1 / 60),
        ("Seconds,voltage [V],speed [rpm]", 1.0),
        ("millis,voltage [V],speed [rpm]", 1000.0),
        ("elapsed_ms,voltage [V],speed [rpm]", 1000.0),
        ("\u0432\u0440\u0435\u043c\u044f,voltage [V],speed [rpm]", 1.0),
    ],
)
def test_a_time_is_found_by_its_name_in_an_import_and_in_a_draft(
    tmp_path: Path, motor: Rig, heading: str, scale: float
) -> None:
    file = log(tmp_path / "log.csv", heading, scale=scale)
    if "1/min" in heading:  # turns only by a name that says so
        file.write_text(file.read_text("utf-8").replace("Speed [1/min]", "Motor speed [rpm]"), "utf-8")
        motor_text = MOTOR.replace("  speed:", "  motor_speed:")
        (tmp_path / "motor.yaml").write_text(motor_text, encoding="utf-8")
        motor = load_rig(tmp_path / "motor.yaml")
    samples = open_run(import_file(file, motor, tmp_path / "runs").path).samples()
    assert samples["time"].to_numpy()[-1] == pytest.approx(5.5)
    drafted = read_columns(file, {})
    assert drafted.times is not None
    assert drafted.times[-1] == pytest.approx(5.5)
    assert "speed" in drafted.columns[-1].name


@pytest.mark.parametrize(
    "heading", ["t [s],u [V],n [rpm]", "time_s,voltage_V,speed_rpm", "Zeit,u [V],n [rpm]"]
)
def test_a_time_never_becomes_records_without_a_rig(tmp_path: Path, heading: str) -> None:
    with pytest.raises(RigctlError, match="samples belong to a rig"):
        import_file(log(tmp_path / "log.csv", heading), None, tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


def test_a_steady_duration_in_a_table_is_not_taken_for_an_observation(tmp_path: Path) -> None:
    file = log(tmp_path / "log.csv", "x1 [s],u [V],n [rpm]")
    with pytest.raises(RigctlError, match=r"is it the time.*--columns 'x1=time \[s\]'") as caught:
        import_file(file, None, tmp_path / "runs")
    assert caught.value.where.line == 1
    done = import_file(file, None, tmp_path / "runs", columns=["x1=settling [s]"])
    assert done.records == 12


@pytest.mark.parametrize(
    "times",
    [
        [0, 1, 2, 3, 4, 5, 4, 6, 7, 8, 9],
        [*range(9), *range(9)],
        [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4],
        [0, 1, "", 3, 4, 5, 6],
    ],
    ids=["once back", "starts again", "in whole seconds", "one missing"],
)
def test_a_time_that_is_not_steady_is_not_taken_for_an_observation(
    tmp_path: Path, times: list[object]
) -> None:
    rows = [f"{time},{10 + k}" for k, time in enumerate(times)]
    (tmp_path / "log.csv").write_text("\n".join(["Messung [s],u [V]", *rows, ""]), "utf-8")
    with pytest.raises(RigctlError, match=r"is it the time.*--columns 'Messung=time \[s\]'"):
        import_file(tmp_path / "log.csv", None, tmp_path / "runs")


@pytest.mark.parametrize("durations", [[3, 5, 2, 7, 6, 9, 4], [3, 5, 6, 8, 9, 7]])
def test_durations_up_and_down_are_observations(tmp_path: Path, durations: list[int]) -> None:
    rows = [f"{time},{10 + k}" for k, time in enumerate(durations)]
    (tmp_path / "log.csv").write_text("\n".join(["settling [s],u [V]", *rows, ""]), "utf-8")
    assert import_file(tmp_path / "log.csv", None, tmp_path / "runs").records == len(durations)


def test_a_column_of_dates_is_the_time_whatever_its_name(tmp_path: Path, motor: Rig) -> None:
    rows = [f"2026-06-03 14:00:{k:02},6,{100 + k}" for k in range(12)]
    (tmp_path / "log.csv").write_text("\n".join(["gemessen,voltage [V],speed [rpm]", *rows]), "utf-8")
    done = import_file(tmp_path / "log.csv", motor, tmp_path / "runs")
    assert open_run(done.path).samples()["time"].to_numpy()[-1] == 11.0
    with pytest.raises(RigctlError, match="samples belong to a rig"):
        import_file(tmp_path / "log.csv", None, tmp_path / "runs")


@pytest.mark.parametrize(
    ("heading", "time"),
    [
        ("T [degC]", False),
        ("T", False),
        ("T [s]", True),
        ("temps [degC]", False),
        ("t_K", False),
        ("time [h:min]", True),
        ("data", False),
        ("times", False),
        ("t", True),
        ("Zeit_s [s]", True),
        ("lag_s [s]", False),
        ("Fecha/hora", False),
        ("\u010cas [s]", True),
    ],
)
def test_a_unit_decides_where_a_name_has_two_meanings(heading: str, time: bool) -> None:
    assert time_unit(*split_heading(heading))[0] is time


def test_a_channel_of_the_bench_is_never_the_time(tmp_path: Path) -> None:
    text = MOTOR.replace("speed: {unit: rpm, quantity: angular_speed", "elapsed: {unit: s, quantity: time")
    (tmp_path / "rig.yaml").write_text(text, "utf-8")
    rig = load_rig(tmp_path / "rig.yaml")
    file = log(tmp_path / "log.csv", "time [s],voltage [V],elapsed [s]")
    done = import_file(file, rig, tmp_path / "runs")
    assert open_run(done.path).samples()["elapsed"].to_numpy()[0] == 100.0
    with pytest.raises(RigctlError, match="no unit"):
        import_file(log(tmp_path / "log.csv", "elapsed [s],voltage [V],n"), rig, tmp_path / "runs")


def test_a_second_time_and_texts_are_left_out_with_a_remark(tmp_path: Path, motor: Rig) -> None:
    rows = [f"{k},{1000 * k},{6},{100 + k},{'start' if k == 0 else ''}" for k in range(12)]
    text = "\n".join(["Time [s],elapsed_ms,voltage [V],speed [rpm],Remark", *rows])
    (tmp_path / "log.csv").write_text(text, "utf-8")
    done = import_file(tmp_path / "log.csv", motor, tmp_path / "runs")
    assert "elapsed_ms: it is another time and is left out" in done.notes
    assert "Remark: it has no numbers and is left out" in done.notes
    assert [column.name for column in read_columns(tmp_path / "log.csv", {}).columns] == ["voltage", "speed"]


@pytest.mark.parametrize("kind", ["xlsx", "parquet", "mat", "tdms"])
def test_every_format_finds_the_same_time(tmp_path: Path, motor: Rig, kind: str) -> None:
    times = 0.5 * np.arange(12)
    columns = {"Zeit_ms": 1000.0 * times, "voltage_V": np.full(12, 6.0), "speed_rpm": 100.0 + np.arange(12)}
    path = tmp_path / f"log.{kind}"
    if kind == "xlsx":
        pd.DataFrame(columns).to_excel(path, index=False)
    elif kind == "parquet":
        pd.DataFrame(columns).to_parquet(path)
    elif kind == "mat":
        from scipy.io import savemat

        savemat(path, columns)
    else:
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(str(path)) as writer:
            writer.write_segment([ChannelObject("log", name, values) for name, values in columns.items()])
    done = import_file(path, motor, tmp_path / "runs", options=Options())
    assert np.allclose(open_run(done.path).samples()["time"].to_numpy(), times)
