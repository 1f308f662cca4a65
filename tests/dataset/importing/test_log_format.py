"""The mapping that a rig file names reads the log it was written for, and does not beat a later heading."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl.dataset import Record, open_run
from rigctl.dataset.importing import Options, import_files
from rigctl.dataset.importing.log_format import with_log_format
from rigctl.errors import RigctlError
from rigctl.proposal.columns import read_columns
from rigctl.proposal.log_format import log_format_text
from rigctl.proposal.roles import StatedRoles, with_roles
from rigctl.rig import Rig, load_rig

RIG = """\
name: bench
log_format: log-formats/bench.yaml
channels:
  speed: {unit: %s, quantity: %s}
actuators:
  voltage: {kind: level, unit: V, low: 0 V, high: 12 V}
safe_state: {voltage: 0 V}
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project, which is not the current folder."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "project"
    for name in ("rigs", "log-formats"):
        (folder / name).mkdir(parents=True)
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    return folder


def bench(project: Path, unit: str = "rpm", quantity: str = "angular_speed") -> Rig:
    path = project / "rigs/bench.yaml"
    path.write_text(RIG % (unit, quantity), encoding="utf-8")
    return load_rig(path)


def log(project: Path, heading: str, *, step: float = 1.0, start: float = 0.0, back: bool = False) -> Path:
    times = [start + step * k for k in range(12)]
    times = times[:6] + times[:6] if back else times
    rows = [f"{times[k]:g},{6 if k > 3 else 0},{100 + k}" for k in range(12)]
    path = project / "log.csv"
    path.write_text("\n".join([heading, *rows]) + "\n", encoding="utf-8")
    return path


def draft(
    project: Path, path: Path, units: dict[str, str] | None = None, options: Options | None = None
) -> str:
    table = read_columns(path, units or {}, options)
    text = log_format_text("log-formats/bench.yaml", with_roles(table, StatedRoles(["voltage"], ["speed"])))
    (project / "log-formats/bench.yaml").write_text(text or "{}\n", encoding="utf-8")
    return text or ""


def read(project: Path, path: Path, rig: Rig, options: Options | None = None) -> tuple[Record, str]:
    merged = with_log_format(options or Options(), rig)
    done = import_files([path], rig, project / "runs", merged)
    return open_run(done.path).record(0), "\n".join(done.notes)


RPM = np.pi / 30.0


@pytest.mark.parametrize(
    ("first", "units", "later", "step", "speed"),
    [
        ("t (s),voltage (V),speed (rpm)", {}, "t (ms),voltage (V),speed (rpm)", 1e-3, RPM),
        ("t (s),voltage (V),speed (rpm)", {}, "t (s),voltage (V),speed (rad/s)", 1.0, 1.0),
        ("t (s),Voltage (mV),Speed (rpm)", {}, "t (s),Voltage (V),Speed (rpm)", 1.0, RPM),
        ("t_ms,voltage (V),speed [1/min]", {"speed": "rpm"}, "t_ms,voltage (V),speed [rpm]", 1e-3, RPM),
        ("t,voltage,speed", {"voltage": "V", "speed": "rpm"}, "t,voltage [V],speed [rpm]", 1.0, RPM),
        ("t,voltage,speed", {"voltage": "V", "speed": "rpm"}, "t [ms],voltage,speed", 1e-3, RPM),
        ("t,voltage [V],speed [gizmo]", {"speed": "rpm"}, "t,voltage [V],speed [gizmo]", 1.0, RPM),
        ("t,voltage [V],speed [rad/s]", {"speed": "rpm"}, "t,voltage [V],speed [rad/s]", 1.0, RPM),
    ],
)
def test_a_heading_that_states_its_unit_is_read_in_it(
    project: Path, first: str, units: dict[str, str], later: str, step: float, speed: float
) -> None:
    rig = bench(project)
    draft(project, log(project, first), units)
    record, _ = read(project, log(project, later), rig)
    assert np.allclose(record.time, step * np.arange(12.0))
    assert np.allclose(record.channels["speed"], speed * (100.0 + np.arange(12.0)))


@pytest.mark.parametrize(
    ("first", "units", "later", "said"),
    [
        (
            "t_s,voltage,speed",
            {"speed": "rpm"},
            "t_s,voltage,speed [rad/s]",
            "speed: its heading states [rad/s]",
        ),
        (
            "t_s,voltage,speed",
            {"voltage": "V"},
            "t_s,voltage [mV],speed [rpm]",
            "voltage: its heading states [mV]",
        ),
        ("t_s,voltage,speed", {}, "t_s,voltage,speed [rpm]", "speed: its heading states [rpm]"),
        (
            "t_s,voltage [V],speed [gizmo]",
            {"speed": "rpm"},
            "t_s,voltage [V],speed [gadget]",
            "was written for [gizmo]",
        ),
        (
            "t_s,voltage [V],speed [gizmo]",
            {"speed": "rpm"},
            "t_s,voltage [V],speed",
            "its heading states no unit",
        ),
        (
            "Sample,voltage [V],speed [rpm]",
            {"Sample": "50 ms"},
            "Sample [s],voltage [V],speed [rpm]",
            "50 ms",
        ),
    ],
)
def test_a_heading_with_another_unit_than_the_format_was_written_for_is_refused(
    project: Path, first: str, units: dict[str, str], later: str, said: str
) -> None:
    rig = bench(project)
    draft(project, log(project, first), units)
    with pytest.raises(RigctlError) as refused:
        read(project, log(project, later), rig)
    assert said in str(refused.value)
    assert "--columns" in str(refused.value)
    assert not (project / "runs").exists()


def test_every_file_of_an_import_is_compared(project: Path) -> None:
    rig = bench(project)
    draft(project, log(project, "t_s,voltage,speed"), {"voltage": "V", "speed": "rpm"})
    first = log(project, "t_s,voltage,speed").rename(project / "first.csv")
    second = log(project, "t_s,voltage,speed [rad/s]")
    with pytest.raises(RigctlError, match="its heading states"):
        import_files([first, second], rig, project / "runs", with_log_format(Options(), rig))


def test_what_the_file_does_not_say_itself_is_said_at_each_import(project: Path) -> None:
    rig = bench(project)
    draft(project, log(project, "Sample,voltage,speed"), {"Sample": "50 ms", "voltage": "V", "speed": "rpm"})
    record, notes = read(project, log(project, "Sample,voltage,speed"), rig)
    assert np.allclose(np.diff(record.time), 0.05)
    said = "read as log-formats/bench.yaml says: Sample 50 ms from row to row, voltage in V, speed in rpm"
    assert said in notes


def test_a_time_without_a_unit_stays_one_that_is_remarked(project: Path) -> None:
    rig = bench(project)
    draft(project, log(project, "t,voltage [V],speed [rpm]"))
    _, notes = read(project, log(project, "t,voltage [V],speed [rpm]"), rig)
    assert "t: the times have no unit and are taken as seconds" in notes


def test_how_the_first_logs_times_go_on_is_no_matter_of_later_ones(project: Path) -> None:
    rig = bench(project)
    text = draft(project, log(project, "t,voltage [V],speed [rpm]", back=True))
    assert "times" not in text
    path = log(project, "t,voltage [V],speed [rpm]", back=True)
    with pytest.raises(RigctlError):
        read(project, path, rig)
    typed = draft(project, path, options=Options(times="split", missing=("-1",)))
    assert 'times: "split"' in typed
    assert 'missing: ["-1"]' in typed
    read(project, path, rig)
    with pytest.raises(RigctlError):
        read(project, path, rig, Options(times="refuse"))


def test_the_users_own_columns_come_first(project: Path) -> None:
    rig = bench(project)
    draft(project, log(project, "t_s,voltage,speed"), {"voltage": "V", "speed": "rpm"})
    own = Options(columns={"speed": "speed [rad/s]"})
    record, _ = read(project, log(project, "t_s,voltage,speed [rad/s]"), rig, own)
    assert record.channels["speed"][0] == pytest.approx(100.0)


def test_a_log_format_that_does_not_exist_is_named(project: Path) -> None:
    with pytest.raises(RigctlError, match=r"log-formats/bench\.yaml"):
        with_log_format(Options(), bench(project))
