"""`rigctl init` makes a working project; `rigctl doctor` lists what is installed and how to get the rest."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rigctl.cli.commands.doctor import doctor
from rigctl.cli.main import app
from rigctl.errors import RigctlError
from systems import listed_ports, own_state
from tclab_board import Served


@pytest.fixture(autouse=True)
def no_guards_of_other_tests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Guards of earlier tests may still try to reach a closed board, which doctor would report."""
    for name, value in own_state(tmp_path / "state").items():
        monkeypatch.setenv(name, value)


def test_init_makes_a_project_whose_procedures_are_valid(tmp_path: Path) -> None:
    made = CliRunner().invoke(app, ["init", str(tmp_path / "bench"), "--json"])
    assert made.exit_code == 0
    files = [Path(file) for file in json.loads(made.stdout)["files"]]
    procedures = [file for file in files if file.parent.name == "procedures"]
    assert len(procedures) >= 5
    for procedure in procedures:
        checked = CliRunner().invoke(app, ["check", str(procedure)])
        assert checked.exit_code == 0, (procedure.name, checked.output)


def test_init_overwrites_nothing(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("mine", encoding="utf-8")
    with pytest.raises(RigctlError, match="nothing is overwritten"):
        CliRunner().invoke(app, ["init", str(tmp_path)], catch_exceptions=False)
    assert [file.name for file in tmp_path.iterdir()] == ["README.md"]
    assert (tmp_path / "README.md").read_text(encoding="utf-8") == "mine"


def test_init_suggests_what_to_do_in_an_unwritable_place(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(RigctlError, match="cannot write the project folder"):
        CliRunner().invoke(app, ["init", str(tmp_path / "file" / "bench")], catch_exceptions=False)


def test_doctor_passes_in_this_environment_and_lists_the_extras() -> None:
    shown = CliRunner().invoke(app, ["doctor", "--json"])
    assert shown.exit_code == 0
    findings = {finding["subject"]: finding for finding in json.loads(shown.stdout)["findings"]}
    assert findings["numba"]["state"] == "ok"
    assert findings["compiled models"]["state"] == "ok"
    for name in ("tdms", "mdf", "xlsx"):
        extra = findings[f"{name} (extra)"]
        assert extra["state"] == "ok" or extra["fix"] == f"pip install 'rigctl[{name}]'"


def test_doctor_shows_what_to_type_in_full(monkeypatch: pytest.MonkeyPatch) -> None:
    fix = "pip install 'rigctl[tdms]'"
    missing = doctor.Finding("tdms (extra)", "optional", "LabVIEW files cannot be read", fix)
    monkeypatch.setattr(doctor, "examine", lambda ports: iter([missing]))
    shown = CliRunner(env={"COLUMNS": "60"}).invoke(app, ["doctor"])
    assert fix in shown.output


def test_doctor_fails_when_something_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = doctor.Finding("numba", "broken", "not installed", "pip install numba")
    monkeypatch.setattr(doctor, "examine", lambda ports: iter([broken]))
    shown = CliRunner().invoke(app, ["doctor"])
    assert shown.exit_code == 1
    assert "pip install numba" in shown.output


def test_doctor_lists_ports_and_their_fixes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from rigctl.backends.transport import serial_ports as ports

    uno = ports.PortInfo("/dev/ttyACM0", "ttyACM0", 0x2341, 0x43, "85", "Arduino Uno", True)
    barred = ports.PortInfo(
        "/dev/ttyUSB0", "USB2.0-Ser!", 0x1A86, 0x7523, None, "CH340", False, "sudo usermod"
    )
    monkeypatch.setattr(ports, "list_ports", lambda: [uno, barred])
    monkeypatch.chdir(tmp_path)
    shown = CliRunner().invoke(app, ["doctor", "--json"])
    assert shown.exit_code == 1
    told = json.loads(shown.stdout)
    assert [port["usb"] for port in told["ports"]] == ["2341:0043", "1A86:7523"]
    findings = {finding["subject"]: finding for finding in told["findings"]}
    assert findings["/dev/ttyACM0"]["detail"] == "Arduino Uno, 2341:0043, 85"
    assert (findings["/dev/ttyUSB0"]["state"], findings["/dev/ttyUSB0"]["fix"]) == ("broken", "sudo usermod")


def test_doctor_says_that_the_system_cannot_list_its_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise OSError("a driver is broken")

    listed_ports(monkeypatch, broken)
    shown = CliRunner().invoke(app, ["doctor", "--json"])
    told = json.loads(shown.stdout)
    findings = {finding["subject"]: finding for finding in told["findings"]}
    assert findings["serial ports"]["detail"] == "the system cannot list them: a driver is broken"
    assert findings["serial ports"]["state"] == "optional"
    assert told["ports"] == []


def test_doctor_identifies_a_given_port() -> None:
    with Served() as board:
        shown = CliRunner().invoke(app, ["doctor", "--port", board.url, "--json"])
    told = json.loads(shown.stdout)
    (asked,) = told["asked"]
    assert asked["name"] == "two-heater board, TCLab Firmware 1.4.0 Arduino Uno"
    assert (asked["link"]["asked"], asked["link"]["answered"]) == (50, 50)
    assert shown.exit_code == 0
    assert board.sketch.heaters == (0.0, 0.0)


def test_doctor_reports_a_port_without_an_answer() -> None:
    shown = CliRunner().invoke(app, ["doctor", "--port", "/dev/no-such-port"], env={"COLUMNS": "300"})
    assert shown.exit_code == 1
    assert "/dev/no-such-port" in shown.stdout
    assert "does it have power?" in shown.stdout


def test_doctor_checks_the_rig_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    old = "{date: 2020-01-01, valid_for: 1 day}"
    old = f"name: a\nchannels: {{p: {{unit: bar, quantity: pressure, calibration: {old}}}}}\n"
    (tmp_path / "rigs" / "a.yaml").write_text(old, encoding="utf-8")
    (tmp_path / "rigs" / "b.yaml").write_text("name: b\nchanels: {}\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    shown = CliRunner().invoke(app, ["doctor", "--json"])
    findings = {finding["subject"]: finding for finding in json.loads(shown.stdout)["findings"]}
    assert "ran out on 2020-01-02" in findings["a.yaml"]["detail"]
    assert findings["a.yaml"]["fix"].startswith("rigctl calibrate p --rig ")
    assert findings["b.yaml"]["state"] == "broken"
    assert "did you mean 'channels'" in findings["b.yaml"]["detail"]


def test_init_minimal_makes_a_project_without_the_shipped_benches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["init", "--minimal"])
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["README.md", "rigctl.toml", "rigs"]
    checked = CliRunner().invoke(app, ["check", "rigs/line-device.yaml"])
    assert checked.exit_code == 0, checked.output
    assert "rigctl family new" in done.output
