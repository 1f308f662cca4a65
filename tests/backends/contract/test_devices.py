"""Faults of a device on a port: silence, disconnection, refusals, nonsense, outputs changed by the device."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import rigctl
from backends.contract.subjects import Subject, value
from patience import patient
from rigctl.backends.errors import BackendLost
from rigctl.backends.protocol import Backend, Notice, Sample
from rigctl.testing.contract import samples

#: opens a bench, switches its heater on, reports it, and continues sampling
HOST = """
import sys
from pathlib import Path
from rigctl.backends.registry import create_backend
from rigctl.clock import real_clock
from rigctl.rig import load_rig
bench = create_backend(load_rig(Path(sys.argv[1])), sys.argv[2], real_clock(), {"port": sys.argv[3]})
bench.open()
bench.start(10.0)
bench.command("relief_valve", 2e6).wait()
bench.command("heater", 1.0).wait()
print("on", flush=True)
while True:
    bench.next_sample(1.0)
"""

STEP = """\
procedure: step
rig: rig.yaml
steps:
  - set: {heater: on}
  - record: {name: step, rate: 10 Hz}
    do:
      - set: {relief_valve: 20 bar}
      - wait: 1 s
"""


@contextmanager
def opened(device: Subject) -> Iterator[Backend]:
    bench = device.make()
    bench.open()
    try:
        bench.start(10.0)
        yield bench
    finally:
        bench.close()


def wait_for(condition: Callable[[], object]) -> None:
    while not condition():
        time.sleep(0.005)


class Watched:
    """A bench that is sampled until a condition holds."""

    def __init__(self, bench: Backend) -> None:
        self.bench = bench
        self.notices: list[Notice] = []
        self.newest: Sample | None = None

    def until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self.newest = self.bench.next_sample(0.2) or self.newest
            self.notices += self.bench.take_notices()

    def until_said(self, kind: str, text: str) -> None:
        self.until(lambda: self.said(kind, text))

    def said(self, kind: str, text: str) -> bool:
        return any(one.kind == kind and text in one.message for one in self.notices)


def test_readings_agree_with_the_plant_and_are_nan_while_missing(device: Subject) -> None:
    server = device.server
    assert server is not None
    with opened(device) as bench:
        bench.command("relief_valve", 30e5).wait()
        watched = Watched(bench)
        watched.until(lambda: server.circuit.read()["supply_pressure"] > 29.9e5)
        newest = samples(bench, 3)[-1]
        assert value(device.rig, newest, "supply_pressure") == pytest.approx(30.0, abs=0.15)
        celsius = server.circuit.read()["oil_temperature"] - 273.15
        assert value(device.rig, newest, "oil_temperature") == pytest.approx(celsius, abs=0.05)
        assert newest.commands == (0.0, 30e5)

        def pressure() -> float:
            return value(device.rig, watched.newest, "supply_pressure") if watched.newest else 0.0

        server.broken = True
        watched.until(lambda: math.isnan(pressure()))
        server.broken = False
        watched.until(lambda: not math.isnan(pressure()))
        server.refusing = True
        watched.until(lambda: math.isnan(pressure()))
        if device.kind == "opcua":  # for each value separately: the others continue
            assert watched.newest is not None
            assert not math.isnan(value(device.rig, watched.newest, "oil_temperature"))
        else:
            watched.until(lambda: any(notice.kind == "fault" for notice in watched.notices))
        server.refusing = False
        watched.until(lambda: not math.isnan(pressure()))


def test_a_lost_device_is_reconnected_with_outputs_off(device: Subject) -> None:
    server = device.server
    assert server is not None

    def silence(*, begin: bool) -> None:
        server.mute = begin

    def unplug(*, begin: bool) -> None:
        (server.stop if begin else server.start)()

    with opened(device) as bench:
        for fault in (silence, unplug):
            bench.command("heater", 1.0).wait()
            samples(bench, 2)
            watched = Watched(bench)
            fault(begin=True)
            watched.until_said("fault", "contact with the device is lost")
            with pytest.raises(BackendLost):
                bench.command("heater", 1.0)
            with pytest.raises(BackendLost):
                bench.safe()
            fault(begin=False)
            watched.until_said("note", "the device is back")
            assert watched.said("gap", "heater went to the safe state")
            assert server.circuit.off
            assert samples(bench, 2)[-1].commands == (0.0, 0.0)
        bench.command("heater", 1.0).wait()
        assert server.circuit.outputs["heater"] == 1.0
    assert server.circuit.off


def test_a_late_answer_is_not_taken_as_that_of_another_query(device: Subject) -> None:
    server = device.server
    assert server is not None
    with opened(device) as bench:
        bench.command("relief_valve", 30e5).wait()
        watched = Watched(bench)
        watched.until(lambda: server.circuit.read()["supply_pressure"] > 29.9e5)
        samples(bench, 2)
        server.delay = 600.0  # longer than any timeout
        watched.until(lambda: bool(watched.notices))
        server.delay = 0.0
        for sample in samples(bench, 12):
            pressure, celsius = (
                value(device.rig, sample, name) for name in ("supply_pressure", "oil_temperature")
            )
            assert math.isnan(pressure) or 0.0 <= pressure < 30.2
            assert math.isnan(celsius) or celsius == pytest.approx(20.0, abs=0.2)
        assert not any(notice.kind == "alarm" for notice in watched.notices + bench.take_notices())
        assert pressure < 30.2


def test_an_output_changed_by_the_device_ends_sampling(device: Subject) -> None:
    server = device.server
    assert server is not None
    with opened(device) as bench:
        bench.command("relief_valve", 20e5).wait()
        server.circuit.set("relief_valve", 55e5)
        watched = Watched(bench)
        with pytest.raises(BackendLost, match="the device has set relief_valve to 55 bar by itself"):
            watched.until(lambda: False)
        assert watched.said("alarm", "by itself")
    assert server.circuit.off


def test_a_killed_or_suspended_host_leaves_the_outputs_off(device: Subject, tmp_path: Path) -> None:
    ending = "SIGSTOP" if device.kind == "modbus" else "SIGKILL"  # the guard is the same for all
    if not hasattr(signal, ending):
        ending = "SIGTERM"  # on Windows a process can only be ended
    server = device.server
    assert server is not None
    (tmp_path / "rig.yaml").write_text(
        patient(device.rig.text, wake="60 s", watchdog="4 s"), encoding="utf-8"
    )
    port = f"socket://127.0.0.1:{server.number}" if device.kind == "serial" else server.port
    command = [sys.executable, "-c", HOST, str(tmp_path / "rig.yaml"), device.kind, port]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as host:
        try:
            assert host.stdout is not None
            assert host.stdout.readline() == "on\n"
            driven = {name: value for _, name, value in server.circuit.switched}
            assert driven == pytest.approx({"heater": 1.0, "relief_valve": 2e6})
            host.send_signal(getattr(signal, ending))
            wait_for(lambda: server.circuit.off)
        finally:
            host.kill()


def test_a_run_ended_by_an_interlock_leaves_the_outputs_off(device: Subject, tmp_path: Path) -> None:
    """The how-to pages, which are run against the same servers, cover a run that finishes."""
    server = device.server
    assert server is not None
    # only the limit may end the run, however late its two samples are on busy cores
    text = device.rig.text.replace("above: 65 bar", "above: 10 bar")
    (tmp_path / "rig.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "step.yaml").write_text(STEP.replace("wait: 1 s", "wait: 60 s"), encoding="utf-8")
    port = f"socket://127.0.0.1:{server.number}" if device.kind == "serial" else server.port
    result = rigctl.run(tmp_path / "step.yaml", port=port, runs=tmp_path / "runs", answers={})
    assert (result.status, "Supply over-pressure" in (result.reason or "")) == ("failed", True), result.reason
    assert [name for _, name, driven in server.circuit.switched if driven] == ["heater", "relief_valve"]
    assert server.circuit.off
    assert result.folder is not None
    record = rigctl.open_run(result.folder).samples(record=0)
    assert float(record["supply_pressure"].iloc[-1]) > 10.0
    assert float(record["relief_valve"].max()) == pytest.approx(20.0)
