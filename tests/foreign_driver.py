"""The package of a driver that knows nothing of rigctl, and the rig file of an instrument that it drives."""

from __future__ import annotations

from pathlib import Path

from rigctl.files.shipped import shipped

#: where the package `bench_driver` is
DRIVERS = Path(__file__).parent / "faults" / "drivers"

#: the measurement unit of the shipped rig, by its foreign driver instead of its lines
BACKEND = """\
backend:
  kind: python
  python:
    driver: bench_driver:Unit
    arguments: {address: "{port}", faults: FAULTS, process: PROCESS}
    timeout: 4 s
    wake: 60 s
    tries: 1
    watchdog: 30 s
    identify: {get: idn}
    channels:
      supply_pressure: {get: pressure}
      oil_temperature: {get: measure, item: temperature, unit: mV}
    actuators:
      heater: {set: relay, confirm: relay}
      relief_valve: {set: set_output, confirm: output, scale: [0, 10], within: 1e-5}
    safe:
      - {call: shutdown}

"""


def rig_with_driver(folder: Path) -> str:
    """The text of the rig file; files in `folder` say how the driver misbehaves, and which its process is."""
    text = shipped("rigs", "oil-circuit-visa.yaml").read_text(encoding="utf-8")
    begin, end = text.index("backend:"), text.index("# What is read are volts")
    backend = BACKEND.replace("FAULTS", str(folder / "faults")).replace("PROCESS", str(folder / "process"))
    return text[:begin] + backend + text[end:]
