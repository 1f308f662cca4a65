"""Headings that can be read in two ways: what is not certain is refused or asked, and never read silently."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from rigctl.command_line import quoted
from rigctl.dataset import Record, open_run
from rigctl.dataset.importing import Options, import_file
from rigctl.dataset.importing.cells.headings import split_ending, split_heading
from rigctl.dataset.importing.read_table import Table, read_table
from rigctl.errors import RigctlError
from rigctl.proposal.columns import read_columns
from rigctl.proposal.from_columns import UnfittingError, need
from rigctl.proposal.roles import StatedRoles, with_roles
from rigctl.proposal.write import quantity_of
from rigctl.rig import load_rig


def write(path: Path, *lines: str, rows: int = 40, row: str = "{k},{c},{k}") -> Path:
    values = [row.format(k=k, t=0.05 * k, c=6 if k > 9 else 0, j=(37 * k) % 11) for k in range(rows)]
    path.write_text("\n".join([*lines, *values]) + "\n", encoding="utf-8")
    return path


def imported(folder: Path, channels: Mapping[str, str], *lines: str, row: str = "{k},{c}") -> Record:
    """The record of a log on a rig with these channels and their units."""
    listed = "\n".join(
        f"  {name}: {{unit: '{unit}', quantity: {quantity_of(unit)}}}" for name, unit in channels.items()
    )
    (folder / "rig.yaml").write_text(f"name: bench\nchannels:\n{listed}\n", encoding="utf-8")
    path = write(folder / "log.csv", *lines, row=row)
    return open_run(import_file(path, load_rig(folder / "rig.yaml"), folder / "runs").path).record(0)


@pytest.mark.parametrize(
    ("heading", "unit"),
    [
        ("angle [ticks]", "deg"),
        ("angle [counts]", "rad"),
        ("angle [count]", "%"),
        ("angle [raw]", "%"),
        ("angle [LSB]", "1"),
        ("angle [deg]", "count"),
        ("angle [%]", "count"),
    ],
)
def test_a_count_is_no_angle_and_no_share(tmp_path: Path, heading: str, unit: str) -> None:
    with pytest.raises(RigctlError, match=r"a count is no|no count"):
        imported(tmp_path, {"angle": unit}, f"time [s],{heading}")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("heading", ["angle [ticks]", "angle [counts]", "angle [raw]", "angle"])
def test_a_count_is_read_where_the_bench_counts(tmp_path: Path, heading: str) -> None:
    assert imported(tmp_path, {"angle": "count"}, f"time [s],{heading}").channels["angle"][-1] == 6.0


def test_a_word_in_parentheses_stays_in_the_name(tmp_path: Path) -> None:
    assert split_heading("Force (raw)") == ("Force (raw)", None)
    table = read_table(write(tmp_path / "a.csv", "Time (s),Force (N),Force (raw)"))
    assert [column.name for column in table.columns] == ["Time", "Force", "Force (raw)"]


def names(table: Table) -> list[tuple[str, str | None]]:
    return [(column.name, column.unit) for column in table.columns]


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (["Duty,Time,Angle", "%,ms,deg"], [("Duty", "%"), ("time", "ms"), ("Angle", "deg")]),
        (["% open,Time,Flow"], [("% open", None), ("time", None), ("Flow", None)]),
        (["%,Time,Flow"], [("%", None), ("time", None), ("Flow", None)]),
        (["% time,u,y"], [("time", None), ("u", None), ("y", None)]),
        (["% motor test", "% run 3", "% time,u,y"], [("time", None), ("u", None), ("y", None)]),
        (["% time,u,y", "% s,V,m"], [("time", "s"), ("u", "V"), ("y", "m")]),
        (["%% motor", "time,u,y"], [("time", None), ("u", None), ("y", None)]),
        (["% motor, bench 3", "time,u,y"], [("time", None), ("u", None), ("y", None)]),
    ],
)
def test_a_percent_sign_is_a_comment_only_above_the_table(
    tmp_path: Path, lines: list[str], expected: list[tuple[str, str | None]]
) -> None:
    found = names(read_table(write(tmp_path / "a.csv", *lines)))
    assert [(name.replace("Time", "time"), unit) for name, unit in found] == expected


def test_a_percent_sign_among_the_values_is_a_bad_row(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "time,u,y")
    path.write_text(path.read_text("utf-8") + "% stopped,1,2\n", encoding="utf-8")
    with pytest.raises(RigctlError, match="stopped"):
        read_table(path)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (["Interval,0.1,s", "t,V,A"], ["t", "V", "A"]),
        (["Interval,1,s", "t,V,A"], ["t", "V", "A"]),
        (["Time,1,min", "t,V,A"], ["t", "V", "A"]),
        (["x-axis,1,2", "second,Volt,Volt"], ["x-axis", "1", "2"]),
        (["Time,1,2", "s,V,V"], ["Time", "1", "2"]),
    ],
)
def test_a_setting_above_short_names_is_no_heading(
    tmp_path: Path, lines: list[str], expected: list[str]
) -> None:
    table = read_table(write(tmp_path / "a.csv", *lines))
    assert [name.replace("time", "Time") for name, _ in names(table)] == [
        one.replace("time", "Time") for one in expected
    ]


@pytest.mark.parametrize(
    ("heading", "time"),
    [
        ("X_Value,Voltage,Speed", "X_Value"),
        ("x-axis,1,2", "x-axis"),
        ("Time,X-Axis,Y-Axis", "Time"),
        ("X-Axis,Y-Axis,Z-Axis", None),
        ("x_value,y_value,note", None),
        ("x_value [s],y_value,note", "x_value"),
        ("x_value [mm],force,note", None),
        ("Voltage,X_Value,Speed", None),
    ],
)
def test_a_horizontal_axis_is_the_time_only_if_nothing_else_may_be(
    tmp_path: Path, heading: str, time: str | None
) -> None:
    table = read_table(write(tmp_path / "a.csv", heading))
    found = None if table.time is None else table.columns[table.time].name.replace("time", "Time")
    assert found == time
    assert len(table.columns) == 3


def test_an_accelerometer_keeps_its_three_axes(tmp_path: Path) -> None:
    table = read_columns(write(tmp_path / "a.csv", "Time,X-Axis,Y-Axis,Z-Axis", row="{t},{c},{k},{j}"), {})
    assert [column.name for column in table.columns] == ["x_axis", "y_axis", "z_axis"]


def test_a_duration_in_a_table_is_not_its_time(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "speed,stopping_time", row="{k},{j}")
    table = read_columns(path, {"stopping_time": "s"})
    assert table.times is None
    assert [column.name for column in table.columns] == ["speed", "stopping_time"]
    counted = read_columns(write(tmp_path / "b.csv", "No,y", row="{t},{j}"), {"No": "ms"})
    assert counted.times is not None
    assert counted.times[-1] == pytest.approx(39 * 0.05e-3)


@pytest.mark.parametrize("unit", ["1/min", "1/s", "1/h"])
def test_a_unit_given_by_the_user_may_begin_with_a_number(tmp_path: Path, unit: str) -> None:
    table = read_columns(write(tmp_path / "a.csv", "time [s],u,flow"), {"flow": unit})
    assert table.column("flow").unit == unit


def test_a_number_before_a_unit_is_read_only_where_the_user_gave_it(tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="unknown unit"):
        imported(tmp_path, {"speed": "V"}, "time [10 min],speed [V]")
    with pytest.raises(RigctlError, match="unknown unit"):
        read_columns(write(tmp_path / "a.csv", "time [10 min],u,y"), {})
    given = read_columns(write(tmp_path / "a.csv", "Sample,u,y"), {"Sample": "50 ms"})
    assert given.times is not None
    assert np.allclose(np.diff(given.times), 0.05)


@pytest.mark.parametrize(
    "name", ["Iq_A", "I1_A", "Imot_A", "I_A", "motor current A", "MotorCurrent_A", "Strom2_A"]
)
def test_a_current_ends_in_its_unit(name: str) -> None:
    assert split_ending(name)[1] == "A"


@pytest.mark.parametrize(
    "name", ["Lamp A", "Damper_A", "Sample A", "Channel A", "pressure_A", "Inlet A", "In A", "Input A"]
)
def test_a_place_called_a_is_no_current(name: str) -> None:
    assert split_ending(name) == (name, None)


def test_the_bench_decides_what_a_final_a_means(tmp_path: Path) -> None:
    record = imported(tmp_path, {"battery": "mA"}, "time_s,battery_A")
    assert record.channels["battery"][-1] == pytest.approx(6.0)
    with pytest.raises(RigctlError, match="pressure_A"):
        imported(tmp_path, {"pressure": "bar"}, "time_s,pressure_A")


@pytest.mark.parametrize(
    ("heading", "wanted"),
    [
        ("position", "rad"),
        ("position [counts]", "rad"),
        ("position [%]", "rad"),
        ("position [1/s]", "rad/s"),
        ("position [Hz]", "rad/s"),
    ],
)
def test_a_template_takes_no_plain_number_for_an_angle(tmp_path: Path, heading: str, wanted: str) -> None:
    table = read_columns(write(tmp_path / "a.csv", f"time [s],force [N],{heading}"), {})
    with pytest.raises(UnfittingError):
        need(with_roles(table, StatedRoles(outputs=["position"])), "output", [wanted], "a position")


@pytest.mark.parametrize(("unit", "wanted"), [("deg", "rad"), ("\N{DEGREE SIGN}", "rad"), ("rpm", "rad/s")])
def test_a_template_takes_an_angle_in_any_unit(tmp_path: Path, unit: str, wanted: str) -> None:
    table = read_columns(write(tmp_path / "a.csv", f"time [s],force [N],position [{unit}]"), {})
    assert need(with_roles(table, StatedRoles(outputs=["position"])), "output", [wanted], "a position")


def test_a_heading_in_a_suggested_command_is_quoted_for_the_shell(tmp_path: Path) -> None:
    table = read_columns(write(tmp_path / "a.csv", "$HOME `x`,u,y", row="{t},{j},{j}"), {})
    with pytest.raises(RigctlError) as refused:
        with_roles(table, StatedRoles())
    assert quoted("$HOME `x`=s") in str(refused.value)
    assert '"$HOME' not in str(refused.value)


def test_options_of_the_user_override_those_of_a_file() -> None:
    assert Options(times="refuse").over(Options(times="drop")).time_policy == "refuse"
    assert Options().over(Options(times="drop")).time_policy == "drop"
