"""Whole commands on a bench of three devices of three protocols with one plant behind them; their faults."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import chdir
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from commands import answer, call, refusal
from patience import unhurried
from protocol_servers import OpcUaServer
from rigctl.backends.combined import bench as combined
from rigctl.dataset import Run, open_run
from rigctl.errors import ExitCode
from rigctl.files.shipped import shipped
from several_devices import SeveralDevices, patient_devices, served_devices

ENDLESS = """\
procedure: endless
rig: rig.yaml
steps:
  - set: {heater: on, cooler: on, relief_valve: 30 bar}
  - wait: 1 h
"""

LINE = "COM7" if sys.platform == "win32" else "/dev/ttyUSB7"


@pytest.fixture(scope="module")
def devices() -> Iterator[SeveralDevices]:
    with served_devices() as served:
        yield served


@pytest.fixture
def project(devices: SeveralDevices, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr("rigctl.runner.rig_lock._state_folder", lambda: tmp_path / "locks")
    monkeypatch.setattr(combined, "_SAFE_WITHIN", 60.0)
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    (tmp_path / "procedure.yaml").write_text(
        shipped("procedures", "oil-circuit-devices.yaml")
        .read_text(encoding="utf-8")
        .replace("rigs/oil-circuit-devices.yaml", "rig.yaml"),
        encoding="utf-8",
    )
    (tmp_path / "endless.yaml").write_text(ENDLESS, encoding="utf-8")
    write_rig(tmp_path)
    with unhurried(), chdir(tmp_path):
        yield tmp_path
    for server in devices.servers.values():
        server.delay, server.mute = 0.0, False
    devices.circuit.switched.clear()


def write_rig(folder: Path, *changes: tuple[str, str], stale_after: str = "60 s") -> None:
    text = patient_devices(
        shipped("rigs", "oil-circuit-devices.yaml").read_text(encoding="utf-8"), stale_after
    )
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    (folder / "rig.yaml").write_text(text, encoding="utf-8")


def run(devices: SeveralDevices, procedure: str, *more: str) -> Result:
    return call("run", procedure, *devices.options, *more, "--json", "--answer-in-browser")


def measured() -> Run:
    return open_run("latest")


class Meanwhile:
    """Does something while a command runs, once a condition holds; an error of it is raised at the end."""

    def __init__(self, when: Callable[[], object], act: Callable[[], None]) -> None:
        self._when, self._act = when, act
        self._error: BaseException | None = None
        self._over = False
        self._thread = threading.Thread(target=self._work)

    def _work(self) -> None:
        try:
            while not self._when():
                if self._over:
                    raise AssertionError("it never came to that")
                time.sleep(0.01)
            self._act()
        except BaseException as error:  # noqa: BLE001 - it is raised where the command has ended
            self._error = error

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._over = True
        self._thread.join()
        if self._error is not None:
            raise self._error


def all_on(devices: SeveralDevices) -> bool:
    return all(devices.circuit.outputs.values())


def test_each_device_is_recorded_at_its_own_rate_and_times(devices: SeveralDevices, project: Path) -> None:
    done = run(devices, "procedure.yaml")
    assert done.exit_code == 0, done.output
    assert devices.circuit.off
    known = measured()
    record = known.record(0)
    assert np.all(np.diff(record.time) >= 0.0)
    channels = ("oil_temperature", "supply_pressure", "line_temperature")
    present = np.column_stack([np.isfinite(record.channels[name]) for name in channels])
    assert np.all(present.sum(axis=1) == 1), "a row is the reading of one device"
    times = {name: record.time[present[:, index]] for index, name in enumerate(channels)}
    assert len({round(float(one), 6) for every in times.values() for one in every}) == len(record.time)
    period = {name: float(np.median(np.diff(every))) for name, every in times.items()}
    assert period["oil_temperature"] == pytest.approx(0.05, rel=0.5)
    assert period["supply_pressure"] == pytest.approx(0.1, rel=0.5), "it is read at its own fastest rate"
    assert record.measures["pressure"] == pytest.approx(30e5, rel=0.02)
    backend = known.info["backend"]
    assert backend["kind"] == "devices"
    assert backend["controller.kind"] == "modbus"
    assert backend["meter.model"] == "34980"
    assert backend["meter.firmware"] == "2.1"
    assert backend["plant.port"] == devices.addresses["plant"]
    switched = {(one.actuator, one.value > 0.0) for one in known.switches}
    assert switched == {(name, on) for name in ("heater", "cooler", "relief_valve") for on in (True, False)}


def test_the_page_of_a_run_names_its_devices(devices: SeveralDevices, project: Path) -> None:
    assert run(devices, "procedure.yaml").exit_code == 0
    page = project / "page.html"
    assert call("report", "latest", "-o", str(page)).exit_code == 0
    text = page.read_text(encoding="utf-8")
    for name, port in devices.addresses.items():
        assert name in text
        assert port in text
    assert "34980" in text


def test_doctor_and_monitor_list_each_device(devices: SeveralDevices, project: Path) -> None:
    found = json.loads(call("doctor", "--rig", "rig.yaml", *devices.options, "--json").output)
    asked = {one["device"]: one for one in found["asked"]}
    assert asked.keys() == devices.servers.keys()
    assert {name: one["port"] for name, one in asked.items()} == devices.addresses
    assert asked["controller"]["values"].keys() == {"oil_temperature"}
    shown = call("monitor", "--rig", "rig.yaml", *devices.options, "--count", "12", "--json")
    assert shown.exit_code == 0, shown.output
    documents = [json.loads(line) for line in shown.stdout.splitlines()]
    assert documents[-1]["devices"].keys() == devices.servers.keys()
    assert not any(one["age"] is None for one in documents[-1]["devices"].values())
    assert None not in documents[-1]["channels"].values()
    assert (
        "controller: 127.0.0.1"
        in call("monitor", "--rig", "rig.yaml", *devices.options, "--count", "12").stderr
    )


@pytest.mark.parametrize("dead", ["controller", "plant", "meter"])
def test_a_dead_device_delays_no_ending_and_is_named(
    dead: str, devices: SeveralDevices, project: Path
) -> None:
    """Its outputs stay as they are, and the run says which they are; the others are off at once."""
    outputs = {"controller": "heater on", "plant": "relief_valve 30 bar", "meter": "cooler on"}
    server = devices.servers[dead]

    def unplug() -> None:
        server.stop()
        assert call_abort(project) == 0

    try:
        with Meanwhile(lambda: all_on(devices), unplug):
            done = run(devices, "endless.yaml")
        on = {name for name, value in devices.circuit.outputs.items() if value}
        document = json.loads(done.stdout)
        assert done.exit_code == ExitCode.FAILED
        assert on == {outputs[dead].split()[0]}
        assert document["unconfirmed"] == f"{dead}: {outputs[dead]}"
        assert f"{dead}: its guard" in document["by_hand"]
    finally:
        server.start()
    off = call("off", "--rig", "rig.yaml", *devices.options)
    assert off.exit_code == 0, off.output
    assert devices.circuit.off


def call_abort(project: Path) -> int:
    from rigctl.dataset.catalogue import run_folders
    from rigctl.runner.operators.remote_control import send
    from rigctl.runner.operators.requests import Request

    send(run_folders(project / "runs")[-1], Request.ABORT, timeout=60.0)
    return 0


@pytest.mark.parametrize("lost", ["controller", "plant", "meter"])
def test_a_lost_device_ends_the_run_and_is_named(lost: str, devices: SeveralDevices, project: Path) -> None:
    write_rig(project, ("stale_after: 60 s", "stale_after: 4 s"))
    server = devices.servers[lost]
    outputs = {"controller": "heater", "plant": "relief_valve", "meter": "cooler"}

    def lose() -> None:
        server.mute = True
        while any(value for name, value in devices.circuit.outputs.items() if name != outputs[lost]):
            time.sleep(0.01)  # the others are off while it is still silent
        server.mute = False

    with Meanwhile(lambda: all_on(devices), lose):
        done = run(devices, "endless.yaml")
    document = json.loads(done.stdout)
    assert done.exit_code == ExitCode.FAILED
    assert f"{lost}: no reading for" in document["reason"]
    # on a busy computer it may answer again only after the ending: that is said, and its guard goes on
    assert devices.circuit.off or document["unconfirmed"].startswith(f"{lost}: {outputs[lost]}")
    switched_off(devices)


def switched_off(devices: SeveralDevices) -> None:
    """Wait until the last output is off."""
    latest = time.monotonic() + 60.0
    while not devices.circuit.off:
        assert time.monotonic() < latest, devices.circuit.outputs
        time.sleep(0.05)


def test_a_device_that_answers_after_seconds_delays_no_ending_of_the_others(
    devices: SeveralDevices, project: Path
) -> None:
    meter = devices.servers["meter"]

    def slow_down() -> None:
        meter.delay = 3.0
        ended = threading.Thread(target=call_abort, args=(project,))
        ended.start()
        while devices.circuit.outputs["heater"] or devices.circuit.outputs["relief_valve"]:
            time.sleep(0.005)
        ended.join()

    with Meanwhile(lambda: all_on(devices), slow_down):
        done = run(devices, "endless.yaml")
    assert json.loads(done.stdout)["unconfirmed"] is None, done.output
    assert devices.circuit.off
    times = {name: at for at, name, value in devices.circuit.switched if not value}
    assert times["cooler"] > times["heater"]
    assert times["cooler"] > times["relief_valve"]


def test_a_limit_of_one_device_switches_all_off(devices: SeveralDevices, project: Path) -> None:
    write_rig(project, ("above: 65 bar", "above: 20 bar"))
    done = run(devices, "endless.yaml")
    assert done.exit_code == ExitCode.FAILED
    assert "Supply over-pressure" in json.loads(done.stdout)["reason"]
    assert devices.circuit.off
    off = {name for _, name, value in devices.circuit.switched if not value}
    assert off == {"heater", "relief_valve", "cooler"}


def test_each_address_is_locked(devices: SeveralDevices, project: Path) -> None:
    """A rig of another name that has one of the devices too is refused meanwhile."""
    other = shipped("rigs", "oil-circuit-modbus.yaml")
    refused: list[str] = []

    def ask() -> None:
        port = devices.addresses["controller"]
        refused.append(refusal("monitor", "--rig", str(other), "--port", port, exit_code=ExitCode.FAILED))
        call_abort(project)

    with Meanwhile(lambda: all_on(devices), ask):
        assert run(devices, "endless.yaml").exit_code == ExitCode.INTERRUPTED
    assert "in use, as 'oil circuit on three devices'" in refused[0]
    free = call("monitor", "--rig", str(other), "--port", devices.addresses["controller"], "--count", "1")
    assert "in use" not in free.output


def test_off_ends_the_run_that_has_the_devices(devices: SeveralDevices, project: Path) -> None:
    answers: list[dict[str, Any]] = []

    def off() -> None:
        answers.append(answer("off", "--rig", "rig.yaml", *devices.options))

    with Meanwhile(lambda: all_on(devices), off):
        assert run(devices, "endless.yaml").exit_code == ExitCode.INTERRUPTED
    assert answers[0]["confirmed"]
    assert devices.circuit.off


def test_an_output_is_moved_by_hand_and_a_channel_calibrated(devices: SeveralDevices, project: Path) -> None:
    done = call("jog", "cooler", "on", "--for", "0.5 s", "--rig", "rig.yaml", *devices.options, "--readings")
    assert done.exit_code == 0, done.output
    assert [(name, value) for _, name, value in devices.circuit.switched] == [
        ("cooler", 1.0),
        ("cooler", 0.0),
    ]
    fitted = call(
        "calibrate", "line_temperature", "--rig", "rig.yaml", *devices.options, "--readings", "3", "--dry",
        "--json",
    )  # fmt: skip
    assert "too few points" in str(fitted.exception)  # nobody gives a reference value
    assert devices.circuit.off


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--port", "192.168.0.9:502"), "which device is at this address?"),
        (
            ("--port", "controler=192.168.0.9:502"),
            "unknown device, got 'controler'; did you mean 'controller'?",
        ),
        (("--port", "meter=a", "--port", "meter=b"), "two addresses for 'meter'"),
        (("--backend", "modbus"), "has several devices"),
        (("--port", f"meter=ASRL{LINE}::INSTR", "--port", f"controller={LINE}"), "at one address"),
    ],
)
def test_wrong_addresses_are_refused(options: tuple[str, ...], said: str, project: Path) -> None:
    assert said in refusal("run", "procedure.yaml", *options, "--answer-in-browser")


def test_a_record_faster_than_a_device_answers_is_refused(devices: SeveralDevices, project: Path) -> None:
    """Once it is known how long its answers take; the message says what to write."""
    write_rig(project, ("fastest: 20 Hz", "fastest: 50 Hz"))
    (project / "fast.yaml").write_text(
        "procedure: fast\nrig: rig.yaml\nsteps:\n  - record: {name: r, rate: 50 Hz}\n    do: [{wait: 1 s}]\n",
        encoding="utf-8",
    )
    devices.servers["meter"].delay = 0.2
    done = run(devices, "fast.yaml")
    assert "device 'meter' can deliver" in json.loads(done.stdout)["reason"]


SHORT = """\
procedure: short
rig: rig.yaml
steps:
  - set: {heater: on, cooler: on, relief_valve: 30 bar}
  - wait: 4 s
"""


def with_policy(folder: Path, device: str, policy: str, *changes: tuple[str, str]) -> None:
    kind = {"controller": "modbus", "plant": "opcua", "meter": "visa"}[device]
    write_rig(
        folder,
        (f"  {device}:\n    kind: {kind}\n", f"  {device}:\n    kind: {kind}\n    {policy}\n"),
        ("stale_after: 60 s", "stale_after: 4 s"),
        *changes,
    )


@pytest.mark.parametrize("lost", ["controller", "plant", "meter"])
def test_a_run_waits_for_a_device_and_goes_on_once_it_is_back(
    lost: str, devices: SeveralDevices, project: Path
) -> None:
    with_policy(project, lost, "lost: pause\n    back_within: 60 s")
    (project / "short.yaml").write_text(SHORT, encoding="utf-8")
    server = devices.servers[lost]
    output = {"controller": "heater", "plant": "relief_valve", "meter": "cooler"}[lost]

    def lose() -> None:
        server.mute = True
        while any(value for name, value in devices.circuit.outputs.items() if name != output):
            time.sleep(0.01)  # the others are off while it is still silent
        server.mute = False

    with Meanwhile(lambda: all_on(devices), lose):
        done = run(devices, "short.yaml")
    document = json.loads(done.stdout)
    assert document["status"] == "finished", done.output
    assert document["unconfirmed"] is None
    assert devices.circuit.off
    switched = [(name, value > 0.0) for _, name, value in devices.circuit.switched]
    assert {name: [on for one, on in switched if one == name] for name in devices.circuit.outputs} == {
        name: [True, False, True, False] for name in devices.circuit.outputs
    }
    (absence,) = measured().info["absences"]
    assert (absence["device"], absence["lost"]) == (lost, "pause")
    assert absence["end"] > absence["begin"]
    events = measured().events
    states = list(events["message"][events["kind"] == "state"])
    assert states[2:4] == ["running → paused", "paused → running"]
    page = project / "page.html"
    assert call("report", "latest", "-o", str(page)).exit_code == 0
    assert f"{lost}: gone from" in page.read_text(encoding="utf-8")


def test_a_run_waits_no_longer_than_the_rig_file_says(devices: SeveralDevices, project: Path) -> None:
    with_policy(project, "plant", "lost: pause\n    back_within: 1 s")
    server = devices.servers["plant"]
    try:
        with Meanwhile(lambda: all_on(devices), server.stop):
            done = run(devices, "endless.yaml")
        document = json.loads(done.stdout)
        assert done.exit_code == ExitCode.FAILED
        assert "it did not come back within 1 s" in document["reason"]
        assert document["unconfirmed"] == "plant: relief_valve 30 bar"
        on = {name for name, value in devices.circuit.outputs.items() if value}
        assert on == {"relief_valve"}
    finally:
        server.start()
    assert call("off", "--rig", "rig.yaml", *devices.options).exit_code == 0
    assert devices.circuit.off


#: a meter that only measures
METER = (
    ('        - {send: "ROUT:CLOS? (@201)", reply: "{cooler}", every: 0.5 s}\n', ""),
    (
        """\
      actuators:
        cooler:
          send: "ROUT:{value} (@201);*OPC?"
          reply: "1"
          words: {off: "OPEN", on: "CLOS"}
          answers: {off: "0", on: "1"}
      confirm: {send: "SYST:ERR?", reply: "+0,{_}"}
""",
        "",
    ),
    ("  cooler: {device: meter, kind: switch, description: water valve of the oil cooler}\n", ""),
    (", cooler: off}", "}"),
)


@pytest.mark.parametrize("returns", [False, True])
def test_a_run_goes_on_without_a_device_that_nothing_needs(
    returns: bool, devices: SeveralDevices, project: Path
) -> None:
    with_policy(project, "meter", "lost: continue", *METER)
    (project / "short.yaml").write_text(
        "procedure: short\nrig: rig.yaml\nsteps:\n  - set: {heater: on}\n"
        # it is believed when what it may still have to answer is answered, or given up
        f"  - record: {{name: r, rate: 10 Hz}}\n    do: [wait: {26 if returns else 14} s]\n",
        encoding="utf-8",
    )
    server = devices.servers["meter"]

    def lose() -> None:
        time.sleep(2.0)
        server.mute = True
        if returns:
            time.sleep(7.0)
            server.mute = False

    with Meanwhile(lambda: devices.circuit.outputs["heater"], lose):
        done = run(devices, "short.yaml")
    server.mute = False
    document = json.loads(done.stdout)
    assert document["status"] == "finished", done.output
    assert devices.circuit.off
    known = measured()
    (absence,) = known.info["absences"]
    assert (absence["device"], absence["lost"], absence["end"] is not None) == ("meter", "continue", returns)
    record = known.record(0)
    assert record.outcome == "complete"
    assert np.isfinite(record.channels["oil_temperature"]).sum() > 100
    last = record.time[np.isfinite(record.channels["line_temperature"])].max()
    assert bool(last > absence["begin"]) is returns


def test_a_stranger_in_the_place_of_a_device_that_nothing_needs_is_told_once(
    devices: SeveralDevices, project: Path
) -> None:
    """It is sent nothing, and what it reads is no reading of the bench."""
    with_policy(project, "meter", "lost: continue", *METER)
    (project / "short.yaml").write_text(
        "procedure: short\nrig: rig.yaml\nsteps:\n  - set: {heater: on}\n"
        "  - record: {name: r, rate: 10 Hz}\n    do: [wait: 14 s]\n",
        encoding="utf-8",
    )
    server = devices.servers["meter"]

    def exchange() -> None:
        server.stop()
        server.exchanged = True
        server.start()

    try:
        with Meanwhile(lambda: devices.circuit.outputs["heater"], exchange):
            done = run(devices, "short.yaml")
    finally:
        server.stop()
        server.exchanged = False
        server.start()
    assert json.loads(done.stdout)["status"] == "finished", done.output
    events = measured().events
    told = [text for text in events["message"] if "another device answers than before" in str(text)]
    assert len(told) == 1
    assert told[0].startswith("meter: ")
    assert told[0].endswith("it is not taken up again in this run")
    assert not server.to_stranger
    (absence,) = measured().info["absences"]
    assert (absence["device"], absence["end"]) == ("meter", None)
    assert devices.circuit.off


RECORDED = """\
procedure: recorded
rig: rig.yaml
steps:
  - set: {heater: on, cooler: on, relief_valve: 30 bar}
  - record: {name: r, rate: 10 Hz}
    do: [wait: 5 s]
"""


@pytest.mark.parametrize("jump", [3600.0, -3600.0])
def test_a_device_whose_clock_jumps_is_recorded_at_the_times_of_the_host(
    jump: float, devices: SeveralDevices, project: Path
) -> None:
    """Its server and its sources agree with one another: values are as new as before."""
    (project / "recorded.yaml").write_text(RECORDED, encoding="utf-8")
    plant = devices.servers["plant"]
    assert isinstance(plant, OpcUaServer)
    try:
        with Meanwhile(lambda: all_on(devices), lambda: setattr(plant, "skew", jump)):
            done = run(devices, "recorded.yaml")
    finally:
        plant.skew = 0.0
    assert json.loads(done.stdout)["status"] == "finished", done.output
    record = measured().record(0)
    present = np.isfinite(record.channels["supply_pressure"])
    assert np.all(np.diff(record.time) >= 0.0)
    assert record.time[present][-1] - record.time[present][0] == pytest.approx(5.0, abs=1.0)
    assert record.outcome == "complete"
    assert devices.circuit.off


@pytest.mark.parametrize("jump", [3600.0, -3600.0])
def test_sources_whose_clock_alone_jumps_have_no_value_and_the_run_ends_with_one_message(
    jump: float, devices: SeveralDevices, project: Path
) -> None:
    """Nobody knows then how old a value is."""
    write_rig(project, ("stale_after: 60 s", "stale_after: 4 s"))
    plant = devices.servers["plant"]
    assert isinstance(plant, OpcUaServer)

    def leap() -> None:
        plant.frozen = datetime.now(UTC) + timedelta(seconds=jump)

    try:
        with Meanwhile(lambda: all_on(devices), leap):
            done = run(devices, "endless.yaml")
    finally:
        plant.frozen = None
    document = json.loads(done.stdout)
    assert done.exit_code == ExitCode.FAILED
    assert "supply_pressure gives no value" in document["reason"]
    assert document["unconfirmed"] is None
    events = measured().events
    assert events["message"][events["kind"] == "alarm"].str.contains("gives no value").sum() == 1
    assert devices.circuit.off


#: the meter by a foreign driver, instead of its lines
DRIVER = """\
    kind: python
    port: 10.0.0.23:5025
    python:
      driver: bench_driver:Unit
      arguments: {address: "{port}", faults: FOLDER/faults, process: FOLDER/process}
      timeout: 4 s
      wake: 60 s
      tries: 1
      watchdog: 30 s
      identify: {get: idn}
      channels:
        line_temperature: {get: measure, item: temperature, unit: mV}
      actuators:
        cooler: {set: relay, confirm: relay}
      safe:
        - {call: shutdown}

"""


@pytest.mark.parametrize("fault", ["", "hangs", "raises"])
def test_a_driver_is_one_of_several_devices(
    fault: str, devices: SeveralDevices, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drivers = str(Path(__file__).parent / "drivers")
    monkeypatch.setenv("PYTHONPATH", drivers)
    monkeypatch.syspath_prepend(drivers)
    monkeypatch.setattr(
        "rigctl.backends.python.permission._file", lambda: project / "config" / "drivers.json"
    )
    (project / "faults").write_text("", encoding="utf-8")
    text = (project / "rig.yaml").read_text(encoding="utf-8")
    begin, end = text.index("    kind: visa\n"), text.index("# 'device' says to which device")
    text = text[:begin] + DRIVER.replace("FOLDER", project.as_posix()) + text[end:]
    (project / "rig.yaml").write_text(text.replace("stale_after: 60 s", "stale_after: 6 s"), encoding="utf-8")
    meter = devices.servers["meter"]
    options = [one.replace(meter.port, f"127.0.0.1:{meter.number}") for one in devices.options]
    more = ("--allow-driver", "bench_driver", "--json", "--answer-in-browser")
    if not fault:
        done = call("run", "procedure.yaml", *options, *more)
        assert done.exit_code == 0, done.output
        known = measured()
        assert known.info["backend"]["meter.driver"] == "bench_driver:Unit"
        assert known.info["backend"]["meter.identity"] == "ACME,34980,MY44001234,2.1"
        readings = known.samples()["line_temperature"].dropna()
        assert len(readings) > 5
        assert readings.iloc[0] == pytest.approx(20.0, abs=1.0)
        assert "cooler" in {one.actuator for one in known.switches if one.value > 0.0}
    else:
        break_down = partial((project / "faults").write_text, f"temperature {fault}", encoding="utf-8")
        with Meanwhile(lambda: all_on(devices), lambda: break_down() and None):
            done = call("run", "endless.yaml", *options, *more)
        document = json.loads(done.stdout)
        assert done.exit_code == ExitCode.FAILED, done.output
        said = {"hangs": "has not come back from 'get measure'", "raises": "the instrument is offline"}
        assert "meter: " in document["reason"]
        assert said[fault] in document["reason"]
    switched_off(devices)


def test_what_needs_a_device_is_named_before_anything_moves(devices: SeveralDevices, project: Path) -> None:
    with_policy(project, "meter", "lost: continue")
    assert "a run cannot go on without 'meter': safe_state needs cooler" in refusal("check", "rig.yaml")
    with_policy(project, "meter", "lost: continue", *METER)
    assert call("check", "rig.yaml").exit_code == 0
    (project / "needs.yaml").write_text(
        "procedure: needs\nrig: rig.yaml\nsteps:\n"
        "  - wait: {until: line_temperature > 10 degC, timeout: 9 s}\n"
        "  - record: {name: r, rate: 10 Hz}\n    do:\n      - wait: 1 s\n"
        "      - measure: {name: m, value: mean(line_temperature), unit: degC}\n"
        "  - if: line_temperature > 90 degC\n    do: [wait: 1 s]\n",
        encoding="utf-8",
    )
    for command in ("check", "run"):
        options = (*devices.options, "--answer-in-browser") if command == "run" else ()
        said = refusal(command, "needs.yaml", *options)
        assert "needs.yaml:4:5: the rig file says 'lost: continue' for 'meter', and steps need it" in said
        assert "(line 4) needs line_temperature" in said
        assert "(line 8) needs line_temperature" in said
        assert "(line 9) needs line_temperature" in said
    assert not devices.circuit.switched
