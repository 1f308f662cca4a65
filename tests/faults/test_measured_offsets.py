"""From a measured offset to a comparison, by whole commands on three servers in real time.

The thermometer of the meter is read 0.4 s late. Its input is connected to the output of the valve for the
measurement, and back to the line, which warms slowly, for the run.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import call
from patience import unhurried
from protocol_servers import Circuit
from rigctl.backends.combined import bench as combined
from rigctl.files.shipped import shipped
from several_devices import AGES, SeveralDevices, Wired, patient_devices, served_devices

ALIGN = "\nalign: {actuator: relief_valve, to: 30 bar, channels: [line_temperature], hold: 2 s, repeats: 4}\n"
#: of the line, K and s
WARMER, SLOWNESS = 20.0, 4.0
PROCEDURE = """\
procedure: warming
rig: rig.yaml
steps:
  - record: {name: warming, rate: 10 Hz, most_missing: 90 %}
    do:
      - wait: 3 s
      - set: {relief_valve: 30 bar}
      - wait: 7 s
      - set: {relief_valve: 0 bar}
      - wait: 7 s
"""
FAMILY = """\
family: line
states:
  temperature: {start: 20 degC, scale: 0.1 K, rate: (ambient + gain*relief_valve - temperature)/slowness}
inputs:
  relief_valve: {value: 0 bar}
parameters:
  gain: {value: 0.5 K/bar, bounds: [0.1 K/bar, 2 K/bar]}
  slowness: {value: 3 s, bounds: [0.5 s, 20 s]}
constants: {ambient: 20 degC}
outputs:
  line_temperature: {unit: degC, formula: temperature}
"""
MODEL = """\
model: line.yaml
rig: rig.yaml
parameters:
  gain: {value: 0.5 K/bar, fit: true}
  slowness: {value: 3 s, fit: true}
"""


class Line(Wired):
    """The meter's inputs: connected to the valve's output, or to a line that warms while the valve is on.

    The line is at ambient temperature when it is connected, as the model says of the start of a record: what
    the valve did before, during the measurement of the offset, would still be warm on a fast computer and not
    on a slow one.
    """

    def __init__(self, circuit: Circuit, age: float) -> None:
        super().__init__(circuit, age)
        self._connected = math.inf
        self._noise = np.random.default_rng(1)

    def connect_line(self) -> None:
        self._connected = time.monotonic()

    def connect_valve(self) -> None:
        self._connected = math.inf

    def read(self) -> dict[str, float]:
        if self._connected == math.inf:
            return super().read()
        then, at, warmer, target = time.monotonic() - self.age, -math.inf, 0.0, 0.0
        switched = [(when, value) for when, name, value in self._circuit.switched if name == "relief_valve"]
        switched = [(when, value) for when, value in switched if when > self._connected]
        for when, value in [*switched, (math.inf, 0.0)]:
            end = min(when, then)
            warmer = target + (warmer - target) * math.exp(-(end - at) / SLOWNESS)
            if when >= then:
                break
            at, target = when, WARMER if value else 0.0
        noise = self._noise.normal(0.0, 0.3)
        return super().read() | {"line_temperature": 293.15 + warmer + noise}


@pytest.fixture
def devices() -> Iterator[SeveralDevices]:
    with served_devices() as served:
        served.servers["meter"].circuit = Line(served.circuit, AGES["meter"])  # type: ignore[assignment]
        yield served


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr("rigctl.runner.rig_lock._state_folder", lambda: tmp_path / "locks")
    monkeypatch.setattr(combined, "_SAFE_WITHIN", 60.0)
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    text = shipped("rigs", "oil-circuit-devices.yaml").read_text(encoding="utf-8")
    text = patient_devices(text).replace("noise: 0.05 K\n    range: [-49", "noise: 0.3 K\n    range: [-49")
    (tmp_path / "rig.yaml").write_text(text + ALIGN, encoding="utf-8")
    (tmp_path / "warming.yaml").write_text(PROCEDURE, encoding="utf-8")
    (tmp_path / "line.yaml").write_text(FAMILY, encoding="utf-8")
    (tmp_path / "model.yaml").write_text(MODEL, encoding="utf-8")
    with unhurried(), chdir(tmp_path):
        yield tmp_path


def _answer(*command: str) -> dict[str, Any]:
    done = call(*command, "--json")
    assert done.exit_code in (0, 4), (done.output, done.exception)
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def _warming(devices: SeveralDevices) -> None:
    devices.servers["meter"].circuit.connect_line()  # type: ignore[attr-defined]
    done = call("run", "warming.yaml", *devices.options, "--json", "--answer-in-browser")
    assert done.exit_code == 0, done.output
    assert devices.circuit.off


def test_a_late_device_is_a_known_offset_once_it_is_measured_and_a_delay_before(
    devices: SeveralDevices, project: Path
) -> None:
    _warming(devices)
    before = _answer("diagnose", "latest", "--model", "model.yaml")
    devices.servers["meter"].circuit.connect_valve()  # type: ignore[attr-defined]
    _answer("doctor", "--align", "--rig", "rig.yaml", *devices.options, "--yes", "--write")
    _warming(devices)
    found = _answer("diagnose", "latest", "--model", "model.yaml")
    # Before: the lateness of one device is taken for a delay, which the answer does not hide.
    assert before["verdict"] == "ambiguous"
    assert "dead_time_of_relief_valve" in before["classes"][0]
    # After: it is an offset that was measured; nothing is missing, and the fit finds what was planted.
    assert (found["verdict"], found["effects"]) == ("adequate", [])
    (clock,) = found["clocks"]
    assert (clock["channels"], clock["beyond"]) == (["line_temperature"], False)
    assert abs(clock["behind"] + AGES["meter"]) < max(3.0 * clock["std"], 0.1), clock
