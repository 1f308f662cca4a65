"""Files in the formats of LabVIEW, MDF tools and MATLAB, and messages for those that cannot be read."""

from __future__ import annotations

import struct
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from rigctl.dataset import Run, open_run
from rigctl.dataset.importing import Options, import_file
from rigctl.dataset.importing.formats import formats
from rigctl.errors import RigctlError
from rigctl.rig import Rig, load_rig

RIG = Path(__file__).parents[3] / "rigs" / "hl32-bench.yaml"
TIME = np.arange(20) * 0.01
POSITION = np.linspace(0.0, 5.0, 20)


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The readers themselves; test_hostile_files.py and the journeys run them apart."""
    monkeypatch.setattr(formats, "isolated", False)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig(RIG)


def tdms(path: Path, *channels: tuple[str, str, Any, dict[str, Any]]) -> Path:
    with TdmsWriter(str(path)) as writer:
        writer.write_segment([ChannelObject(*channel) for channel in channels])
    return path


def run_of(path: Path, rig: Rig, **how: Any) -> Run:
    return open_run(import_file(path, rig, path.parent / "runs", **how).path)


def refusal(path: Path, rig: Rig, **how: Any) -> str:
    with pytest.raises(RigctlError) as caught:
        import_file(path, rig, path.parent / "runs", **how)
    assert not (path.parent / "runs").exists()
    return str(caught.value)


# --- TDMS


def test_groups_of_waveforms_are_records(tmp_path: Path, rig: Rig) -> None:
    wave = {"unit_string": "mm", "wf_increment": 0.01, "wf_start_offset": 0.5}
    path = tdms(
        tmp_path / "log.tdms",
        ("Stroke 20 bar", "position", POSITION, wave),
        ("Stroke 30 bar", "position", POSITION[:10], wave),
    )
    run = run_of(path, rig)
    assert run.records["name"].tolist() == ["Stroke 20 bar", "Stroke 30 bar"]
    assert run.record(0).time == pytest.approx(TIME + 0.5)
    assert run.record(0).channels["position"] == pytest.approx(POSITION * 1e-3)
    assert len(run.record(1).time) == 10


def test_time_stamps_are_seconds_since_the_first(tmp_path: Path, rig: Rig) -> None:
    stamps = np.datetime64("2026-01-01T12:00:00", "us") + (TIME * 1e6).astype("timedelta64[us]")
    path = tdms(
        tmp_path / "log.tdms",
        ("Log", "Zeit", stamps, {}),
        ("Log", "Temperatur [deg C]", 20.0 + POSITION, {}),
    )
    run = run_of(path, rig, columns=["Zeit=time [s]", "Temperatur=oil_temperature"])
    assert run.record(0).time == pytest.approx(TIME)
    assert run.record(0).channels["oil_temperature"][0] == pytest.approx(293.15)


def test_a_group_without_time_is_left_out_and_reported(tmp_path: Path, rig: Rig) -> None:
    path = tdms(
        tmp_path / "log.tdms",
        ("Log", "time", TIME, {"unit_string": "s"}),
        ("Log", "position", POSITION, {"unit_string": "mm"}),
        ("Settings", "gain", np.array([1.0]), {}),
    )
    done = import_file(path, rig, tmp_path / "runs")
    assert (done.records, done.rows) == (1, 20)
    assert "group 'Settings' has no time and is left out" in done.notes


def test_a_channel_that_a_group_lacks_is_nan_in_that_record(tmp_path: Path, rig: Rig) -> None:
    time, length = {"unit_string": "s"}, {"unit_string": "mm"}
    path = tdms(
        tmp_path / "log.tdms",
        ("a", "time", TIME, time),
        ("a", "position", POSITION, length),
        ("a", "supply_pressure", POSITION, {"unit_string": "bar"}),
        ("b", "time", TIME, time),
        ("b", "position", POSITION, length),
    )
    run = run_of(path, rig)
    assert np.isnan(run.record(1).channels["supply_pressure"]).all()
    assert run.record(1).channels["position"] == pytest.approx(POSITION * 1e-3)


def test_unreadable_tdms_files_are_reported(tmp_path: Path, rig: Rig) -> None:
    time, length = {"unit_string": "s"}, {"unit_string": "mm"}
    path = tdms(tmp_path / "a.tdms", ("a", "time", TIME, time), ("a", "position", POSITION[:7], length))
    assert "in group 'a': columns of different lengths, got '7 values of position'" in refusal(path, rig)
    path = tdms(
        tmp_path / "b.tdms",
        ("a", "time", TIME, time),
        ("a", "position", POSITION, length),
        ("b", "time", TIME, time),
        ("b", "position", POSITION, {"unit_string": "cm"}),
    )
    said = refusal(path, rig)
    assert (
        "position: its unit is not the same in every group, got \"cm in 'b'\"; expected mm as in 'a'" in said
    )
    path = tdms(
        tmp_path / "c.tdms",
        ("fast", "position", POSITION, {"unit_string": "mm", "wf_increment": 0.01}),
        ("slow", "supply_pressure", POSITION[:5], {"unit_string": "bar", "wf_increment": 0.1}),
    )
    assert "its groups have no channel in common" in refusal(path, rig)
    path = tdms(
        tmp_path / "d.tdms",
        ("a", "position", POSITION, {"unit_string": "mm", "wf_increment": 0.01}),
        ("a", "supply_pressure", POSITION, {"unit_string": "bar", "wf_increment": 0.1}),
    )
    assert "in group 'a': its channels are sampled at different times" in refusal(path, rig)
    path = tdms(tmp_path / "e.tdms", ("a", "time", TIME, time), ("a", "position", POSITION, {}))
    assert "position: the unit is missing" in refusal(path, rig)
    path = tdms(
        tmp_path / "f.tdms", ("a", "time", TIME, time), ("a", "position", [f"{p}" for p in POSITION], length)
    )
    assert "position: the column holds no numbers, got 'text'" in refusal(path, rig)


def test_channels_of_a_group_that_start_at_different_times_are_refused(tmp_path: Path, rig: Rig) -> None:
    def wave(unit: str, start: str) -> dict[str, Any]:
        return {"unit_string": unit, "wf_increment": 0.01, "wf_start_time": np.datetime64(start, "us")}

    channels = (
        ("a", "position", POSITION, wave("mm", "2026-04-03T12:00:00")),
        ("a", "supply_pressure", POSITION, wave("bar", "2026-04-03T12:00:02")),
    )
    path = tdms(tmp_path / "log.tdms", *channels)
    said = refusal(path, rig)
    assert (
        "in group 'a': its channels start at different times, got 'supply_pressure at 2026-04-03T12:00:02"
        in said
    )
    run = run_of(path, rig, options=Options(columns={"supply_pressure": "-"}))
    assert run.header.started == datetime(2026, 4, 3, 12, tzinfo=UTC)


def test_bad_rows_are_counted_in_their_group(tmp_path: Path, rig: Rig) -> None:
    back = TIME.copy()
    back[5] = 0.0
    path = tdms(
        tmp_path / "log.tdms",
        ("a", "time", TIME, {"unit_string": "s"}),
        ("a", "position", POSITION, {"unit_string": "mm"}),
        ("b", "time", back, {"unit_string": "s"}),
        ("b", "position", POSITION, {"unit_string": "mm"}),
    )
    said = refusal(path, rig)
    assert "log.tdms:6: in group 'b': time: it does not increase within a record" in said
    run = run_of(path, rig, keep_good=True)
    assert run.info["rows"] == 39


def test_a_truncated_file_is_reported(tmp_path: Path, rig: Rig) -> None:
    path = tdms(
        tmp_path / "log.tdms",
        ("a", "time", TIME, {"unit_string": "s"}),
        ("a", "position", POSITION, {"unit_string": "mm"}),
    )
    whole = path.read_bytes()
    path.write_bytes(whole[:-80])
    assert "log.tdms: the file is damaged: Last segment" in refusal(path, rig)
    done = import_file(path, rig, tmp_path / "runs", keep_good=True)
    assert (done.rows, len(done.faults)) == (10, 2)  # the library reports it in two ways


# --- MDF


def test_channel_groups_are_records_and_invalid_values_are_missing(tmp_path: Path, rig: Rig) -> None:
    invalid = np.zeros(20, dtype=bool)
    invalid[3] = True
    with MDF(version="4.10") as mdf:
        for name in ("first", "first"):
            position = Signal(POSITION, TIME, name="position", unit="mm", invalidation_bits=invalid)
            valve = Signal((TIME > 0.1).astype(np.uint8), TIME, name="valve")
            mdf.append([position, valve], acq_name=name)
        mdf.save(tmp_path / "log.mf4")
    run = run_of(tmp_path / "log.mf4", rig)
    assert run.records["name"].tolist() == ["first", "first (2)"]
    assert np.flatnonzero(np.isnan(run.record(1).channels["position"])).tolist() == [3]
    assert [switch.value for switch in run.record(1).switches] == [1.0]


def test_rasters_of_one_measurement_are_not_records(tmp_path: Path, rig: Rig) -> None:
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(POSITION, TIME, name="position", unit="mm")])
        mdf.append([Signal(POSITION[:5], TIME[:5], name="supply_pressure", unit="bar")])
        mdf.save(tmp_path / "log.mf4")
    assert "its channel groups have no channel in common" in refusal(tmp_path / "log.mf4", rig)


@pytest.mark.parametrize("version", ["4.10", "3.10"])
def test_a_start_in_local_time_follows_the_zone_that_is_said(tmp_path: Path, rig: Rig, version: str) -> None:
    began = datetime(2026, 7, 3, 14)  # noqa: DTZ001 - the file stores a local time
    with MDF(version=version) as mdf:
        mdf.append([Signal(POSITION, TIME, name="position", unit="mm")])
        mdf.start_time = began
        path = Path(mdf.save(tmp_path / "log"))
    done = import_file(path, rig, tmp_path / "utc")
    assert open_run(done.path).header.started == began.replace(tzinfo=UTC)
    assert "its start names no time zone; it is taken as UTC (--zone says otherwise)" in done.notes
    done = import_file(path, rig, tmp_path / "zone", options=Options(zone="America/New_York"))
    assert open_run(done.path).header.started == datetime(2026, 7, 3, 18, tzinfo=UTC)
    assert not any("time zone" in note for note in done.notes)


def test_a_channel_named_time_beside_the_master_is_reported(tmp_path: Path, rig: Rig) -> None:
    with MDF(version="4.10") as mdf:
        position = Signal(POSITION, TIME, name="position", unit="mm")
        mdf.append([position, Signal(TIME * 2.0, TIME, name="time", unit="s")], acq_name="a")
        mdf.save(tmp_path / "log.mf4")
    done = import_file(tmp_path / "log.mf4", rig, tmp_path / "runs")
    said = "channel group 'a': the channel 'time' is left out, its master channel is the time"
    assert said in done.notes
    assert open_run(done.path).record(0).time == pytest.approx(TIME)


# --- MAT


def test_vectors_are_imported_with_units_from_a_separate_structure(tmp_path: Path, rig: Rig) -> None:
    savemat(
        tmp_path / "log.mat",
        {"time": TIME, "position": POSITION, "units": {"time": "s", "position": "mm"}, "comment": "cold"},
    )
    done = import_file(tmp_path / "log.mat", rig, tmp_path / "runs")
    assert (done.records, done.rows) == (1, 20)
    assert "in the file: 'comment' is a text and is left out" in done.notes


def test_structures_are_records(tmp_path: Path, rig: Rig) -> None:
    units = {"time": "s", "position": "mm"}
    one = {"time": TIME, "position": POSITION, "units": units}
    savemat(tmp_path / "log.mat", {"cold": one, "hot": {**one, "name": "really hot"}, "rate": 100.0})
    done = import_file(tmp_path / "log.mat", rig, tmp_path / "runs")
    run = open_run(done.path)
    assert run.records["name"].tolist() == ["cold", "really hot"]
    assert "variable 'rate' is not a structure and is left out" in done.notes
    assert run.record(1).channels["position"] == pytest.approx(POSITION * 1e-3)


def test_each_element_of_an_array_of_structures_is_a_record(tmp_path: Path, rig: Rig) -> None:
    data = np.empty(3, dtype=[("t", object), ("x", object)])
    for index in range(3):
        data[index] = (TIME, POSITION + index)
    savemat(tmp_path / "log.mat", {"strokes": data})
    run = run_of(tmp_path / "log.mat", rig, columns=["t=time [s]", "x=position [mm]"])
    assert run.records["name"].tolist() == ["strokes(1)", "strokes(2)", "strokes(3)"]


def test_simulink_structures_with_time_are_imported(tmp_path: Path, rig: Rig) -> None:
    signals = np.empty(2, dtype=[("values", object), ("label", object)])
    signals[0] = (POSITION.reshape(-1, 1), "position")
    signals[1] = (np.column_stack([POSITION, POSITION]), "p")
    savemat(tmp_path / "log.mat", {"out": {"time": TIME, "signals": signals}})
    how = ["time=time [s]", "position=position [mm]", "p_1=supply_pressure [bar]", "p_2=-"]
    run = run_of(tmp_path / "log.mat", rig, columns=how)
    assert run.layout.channels == ("supply_pressure", "position")


def test_unreadable_mat_files_are_reported(tmp_path: Path, rig: Rig) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"data": np.zeros((600, 7))})
    assert "'data' is a matrix of 600 x 7, whose columns have no names" in refusal(path, rig)
    savemat(path, {"time": TIME, "position": POSITION[:3]})
    assert "columns of different lengths" in refusal(path, rig)
    savemat(path, {"time": TIME, "position": POSITION})
    assert "time: the unit is missing" in refusal(path, rig) or "position: the unit" in refusal(path, rig)
    savemat(path, {"x": "only text"})
    assert "nothing in it is a table" in refusal(path, rig)
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(600, b" "))
    assert "version 7.3" in refusal(path, rig)


def element(kind: int, content: bytes) -> bytes:
    """An element of a MAT file of version 5, padded to eight bytes."""
    return struct.pack("<II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def matrix(kind: int, name: bytes, *content: bytes) -> bytes:
    """A variable: flags with its class, dimensions, name, content."""
    head = element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack("<ii", 1, 1)) + element(1, name)
    return element(14, head + b"".join(content))


def test_a_function_in_a_file_is_left_out_and_never_called(tmp_path: Path, rig: Rig) -> None:
    """mxFUNCTION_CLASS is 16; MATLAB writes a function handle so."""
    savemat(
        tmp_path / "plain.mat", {"time": TIME, "position": POSITION, "units": {"time": "s", "position": "mm"}}
    )
    function = matrix(16, b"evil", matrix(6, b"", element(9, struct.pack("<d", 1.0))))
    path = tmp_path / "log.mat"
    path.write_bytes((tmp_path / "plain.mat").read_bytes() + function)
    done = import_file(path, rig, tmp_path / "runs")
    assert done.rows == 20
    assert "in the file: 'evil' is a function or an object and is left out" in done.notes


# --- all of them


@pytest.mark.parametrize("ending", ["tdms", "mf4", "mat", "parquet"])
@pytest.mark.parametrize("content", [b"", b"no such thing", bytes(range(256)) * 40])
def test_a_file_of_another_kind_is_reported(tmp_path: Path, rig: Rig, ending: str, content: bytes) -> None:
    path = tmp_path / f"log.{ending}"
    path.write_bytes(content)
    assert "or it is damaged" in refusal(path, rig) or "no data" in refusal(path, rig)


@pytest.mark.parametrize("ending", ["csv", "tdms", "mf4", "mat", "parquet"])
def test_a_missing_file_is_reported(tmp_path: Path, rig: Rig, ending: str) -> None:
    said = refusal(tmp_path / f"none.{ending}", rig)
    assert "there is no such file" in said or "No such file" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("ending", "module", "extra"), [("tdms", "nptdms", "tdms"), ("mf4", "asammdf", "mdf")]
)
def test_a_missing_extra_is_reported(
    tmp_path: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch, ending: str, module: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    path = tmp_path / f"log.{ending}"
    path.write_bytes(b"x")
    assert f"pip install 'rigctl[{extra}]'" in refusal(path, rig)
