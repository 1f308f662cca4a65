"""Whole commands on a bench with a foreign Python driver of a real TCP server; faults of the driver."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

import pytest

from commands import call, refusal
from foreign_driver import DRIVERS, rig_with_driver
from own_process import end_guards
from patience import unhurried
from protocol_servers import ScpiServer
from rigctl.backends.python.permission import allowed, allowing, require_allowed
from rigctl.dataset import open_run
from rigctl.files.shipped import shipped
from rigctl.project import Project, find_project
from rigctl.rig import load_rig

ALLOWED = ("--allow-driver", "bench_driver")

ENDLESS = """\
procedure: endless
rig: rig.yaml
steps:
  - set: {heater: on, relief_valve: 30 bar}
  - wait: 1 h
"""


@pytest.fixture
def server() -> Iterator[ScpiServer]:
    with ScpiServer(load_rig(shipped("rigs", "oil-circuit-visa.yaml"))) as served:
        yield served


@pytest.fixture
def project(tmp_path: Path, state_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr("rigctl.runner.rig_lock._state_folder", lambda: tmp_path / "locks")
    monkeypatch.setenv("PYTHONPATH", str(DRIVERS))
    monkeypatch.syspath_prepend(str(DRIVERS))
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    monkeypatch.setattr(
        "rigctl.backends.python.permission._file", lambda: tmp_path / "config" / "drivers.json"
    )
    (tmp_path / "faults").write_text("", encoding="utf-8")
    write_rig(tmp_path)
    (tmp_path / "endless.yaml").write_text(ENDLESS, encoding="utf-8")
    (tmp_path / "step.yaml").write_text(ENDLESS.replace("1 h", "0.5 s"), encoding="utf-8")
    with unhurried(), chdir(tmp_path):
        yield tmp_path
    end_guards(state_folder)  # those of failed drivers, which would start another every few seconds


def write_rig(folder: Path, *changes: tuple[str, str]) -> None:
    text = rig_with_driver(folder)
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    (folder / "rig.yaml").write_text(text, encoding="utf-8")


def start(server: ScpiServer, procedure: str) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-m",
        "rigctl",
        "run",
        procedure,
        "--port",
        f"127.0.0.1:{server.number}",
        *ALLOWED,
        "--json",
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def port(server: ScpiServer) -> tuple[str, ...]:
    return "--port", f"127.0.0.1:{server.number}", *ALLOWED


def wait_until_on(server: ScpiServer, running: subprocess.Popen[str]) -> None:
    while not all(server.circuit.outputs.values()):
        assert running.poll() is None, running.communicate()
        time.sleep(0.01)


def test_a_run_with_a_driver_is_recorded_with_its_version(server: ScpiServer, project: Path) -> None:
    done = call("run", "step.yaml", *port(server), "--json", "--answer-in-browser")
    assert done.exit_code == 0, done.output
    driven = {name for _, name, value in server.circuit.switched if value}
    assert (driven, server.circuit.off) == ({"heater", "relief_valve"}, True)
    run = open_run("latest")
    backend = json.loads((run.folder / "run.json").read_text(encoding="utf-8"))["backend"]
    assert backend["driver"] == "bench_driver:Unit"
    assert backend["package"] == "bench_driver of unknown version"
    assert backend["identity"] == "ACME,34980,MY44001234,2.1"
    samples = run.samples()
    assert samples["oil_temperature"].dropna().iloc[0] == pytest.approx(20.0, abs=0.2)
    assert samples["relief_valve"].max() == pytest.approx(30.0)


def test_doctor_and_monitor_show_the_driver(server: ScpiServer, project: Path) -> None:
    done = call("doctor", "--rig", "rig.yaml", *port(server))
    for text in (
        "bench_driver (driver)",
        "driver bench_driver:Unit",
        "identity ACME,34980",
        "20 degC",
        "0 bar",
    ):
        assert text in done.output
    shown = call("monitor", "--rig", "rig.yaml", *port(server), "--count", "2", "--json")
    assert shown.exit_code == 0, shown.output
    documents = [json.loads(line) for line in shown.stdout.splitlines()]
    assert documents[-1]["channels"]["oil_temperature"] == pytest.approx(20.0, abs=0.2)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("raises", "OSError: the instrument is offline"),
        ("hangs", "has not come back from 'get pressure' in 4 s"),
        ("ends", "SystemExit: 3"),
        ("text", "pressure of the driver gives no number but ERR 7 (str)"),
        ("nothing", "pressure of the driver gives no number but None (NoneType)"),
        ("array", "pressure of the driver gives no number but ["),
        ("unit", "pressure of the driver is in 'mV'; expected 'V'"),
        pytest.param(
            "dies",
            "the process of the driver has ended (signal 9)",
            marks=pytest.mark.skipif(sys.platform == "win32", reason="there is no such signal"),
        ),
    ],
)
def test_a_driver_that_fails_is_a_lost_device_and_the_bench_ends_safe(
    fault: str, message: str, server: ScpiServer, project: Path
) -> None:
    write_rig(project, ("stale_after: 1 s", "stale_after: 10 s"))
    running = start(server, "endless.yaml")
    wait_until_on(server, running)
    (project / "faults").write_text(fault, encoding="utf-8")
    output, _ = running.communicate(timeout=120)
    assert running.returncode == 1
    reason = json.loads(output[output.index("\n{") :])["reason"]
    assert reason.count(message) == 1, output
    while not server.circuit.off:  # the guard goes on with another process of the driver
        time.sleep(0.01)


@pytest.mark.parametrize("killed", ["runner", "driver"])
def test_outputs_are_off_after_a_kill(killed: str, server: ScpiServer, project: Path) -> None:
    running = start(server, "endless.yaml")
    wait_until_on(server, running)
    number = getattr(signal, "SIGKILL", signal.SIGTERM)
    if killed == "runner":
        running.kill()
    else:
        os.kill(int((project / "process").read_text(encoding="utf-8")), number)
    while not server.circuit.off:
        time.sleep(0.01)
    running.communicate(timeout=120)
    assert running.returncode != 0


def hang(project: Path, how: str) -> int:
    """Let the driver hang; return the process of its guard."""
    guard = int((project / "guard").read_text(encoding="utf-8"))
    (project / "faults").write_text(how, encoding="utf-8")
    while not (project / "hung").exists():
        time.sleep(0.005)
    return guard


def exclusive(project: Path) -> None:
    """A device that only one process can have, as a serial port."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        (project / "exclusive").write_text(str(free.getsockname()[1]), encoding="utf-8")


def test_a_driver_that_hangs_while_nobody_is_left_is_succeeded_and_its_outputs_are_off(
    server: ScpiServer, project: Path
) -> None:
    """rigctl and its guard are killed: the driver's process sees it, ends, and another one switches off."""
    exclusive(project)
    running = start(server, "endless.yaml")
    wait_until_on(server, running)
    guard = hang(project, "hangs")
    for one in (running.pid, guard):
        os.kill(one, getattr(signal, "SIGKILL", signal.SIGTERM))
    running.communicate(timeout=120)
    while not server.circuit.off:
        time.sleep(0.01)


def test_a_driver_that_lets_no_other_code_run_ends_although_its_guard_is_gone(
    server: ScpiServer, project: Path
) -> None:
    """rigctl has another guard, whose driver gets the device only once the process that hangs has ended."""
    exclusive(project)
    running = start(server, "endless.yaml")
    wait_until_on(server, running)
    os.kill(hang(project, "hangs, and nothing else runs"), getattr(signal, "SIGKILL", signal.SIGTERM))
    output, _ = running.communicate(timeout=120)
    assert running.returncode == 1, output
    while not server.circuit.off:
        time.sleep(0.01)


@pytest.mark.parametrize("listed", [False, True])
def test_neither_a_rig_file_nor_its_folder_imports_anything(
    listed: bool, server: ScpiServer, project: Path
) -> None:
    """A stranger's folder has a rigctl.toml, too."""
    (project / "rigctl.toml").write_text('drivers = ["bench_driver"]' if listed else "", encoding="utf-8")
    reached = port(server)[:2]
    refused = refusal("run", "step.yaml", *reached)
    assert "has not been allowed" in refused
    assert "--allow-driver bench_driver" in refused
    assert not (project / "process").exists()
    shown = ("monitor", "--rig", "rig.yaml", *reached, "--count", "1", "--json")
    done = call(*shown, *ALLOWED)
    assert done.exit_code == 0, done.output
    assert ("bench_driver" in allowed()) == listed  # kept, outside the project's own files


@pytest.mark.parametrize("answer", [True, False])
def test_at_a_terminal_the_user_is_asked_once(
    answer: bool, server: ScpiServer, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def confirm(question: str) -> bool:
        asked.append(question)
        return answer

    monkeypatch.setattr("rigctl.cli.attended_run.typing_possible", lambda: True)
    monkeypatch.setattr("rigctl.cli.options.driver.confirm", confirm)
    shown = ("monitor", "--rig", "rig.yaml", *port(server)[:2], "--count", "1", "--json")
    if answer:
        done = call(*shown)
        assert done.exit_code == 0, done.output
    else:
        assert "has not been allowed" in refusal(*shown)
    assert ("bench_driver" in allowed()) == answer  # it is not asked again
    assert len(asked) == 1
    assert "'bench_driver'" in asked[0]
    assert (project / "process").exists() == answer


@pytest.mark.parametrize(
    ("driver", "message"),
    [
        ("bench_driver:Unti", "has no 'Unti'; did you mean 'Unit'?"),
        ("bench_driver.measurement:Unit", "cannot be imported"),
        ("bench_driver:not_a_class", "is no class of bench_driver"),
        ("bench_driver:Path", "is no class of bench_driver"),
        ("os:system", "a module of Python itself"),
        ("bench_drive:Unit", "has not been allowed"),
    ],
)
def test_what_is_no_driver_is_one_message(
    driver: str, message: str, server: ScpiServer, project: Path
) -> None:
    write_rig(project, ("bench_driver:Unit", driver))
    done = call("run", "step.yaml", *port(server))
    assert done.exit_code != 0
    assert message in str(done.exception), done.exception
    assert not server.circuit.switched


def test_a_misspelt_package_is_told_the_nearest_that_is_installed(project: Path) -> None:
    """And nobody is advised to install what the misspelt name may be the name of."""
    (project / "rigctl.toml").write_text('drivers = ["bench_driver"]', encoding="utf-8")
    for typed, meant in (("bench_drivr", "bench_driver"), ("pymeasur", "pymeasure")):
        said = refusal("run", "step.yaml", "--allow-driver", typed)
        assert f"got '{typed}'; did you mean '{meant}'?" in said
        assert "pip install" not in said
    assert "pip install" in refusal("run", "step.yaml", "--allow-driver", "quite_another_thing")


def test_the_settings_of_the_project_are_read_once(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (project / "rigctl.toml").write_text('drivers = ["bench_driver"]', encoding="utf-8")
    read: list[Path] = []

    def found() -> Project:
        read.append(project)
        return find_project()

    monkeypatch.setattr("rigctl.backends.python.permission.find_project", found)
    with allowing(["bench_driver"]):
        require_allowed("bench_driver")
    assert len(read) == 1
    require_allowed("bench_driver")  # it was kept


def test_an_unknown_attribute_is_named_with_the_nearest(server: ScpiServer, project: Path) -> None:
    write_rig(project, ("{get: pressure}", "{get: presure}"))
    done = call("doctor", "--rig", "rig.yaml", *port(server))
    assert "Unit has no 'presure'; did you mean 'pressure'?" in done.output
