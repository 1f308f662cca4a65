"""Time from a signal to safe outputs on the devices that are alive: ``python -m benchmarks.several_devices``.

A whole command runs on servers of Modbus, OPC UA and SCPI in this process, with all outputs on. One device
in turn, or none, receives requests but no longer answers; then the command gets SIGTERM. A server notes when
each output was set. With none dead the same is measured for comparison. Servers and command share the
computer.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.record import keep, table
from benchmarks.several_devices import FOLDER
from rigctl.files.shipped import shipped

sys.path.insert(0, str(FOLDER.parents[1] / "tests"))

from own_process import begin, end_guards
from several_devices import SeveralDevices, patient_devices, served_devices

ENDINGS = int(sys.argv[1]) if len(sys.argv) > 1 else 10
OF = {"controller": "heater", "plant": "relief_valve", "meter": "cooler"}
ASKED = 50.0  # ms, the 99th percentile
PROCEDURE = """\
procedure: endless
rig: rig.yaml
steps:
  - set: {heater: on, cooler: on, relief_valve: 30 bar}
  - wait: 1 h
"""


def main() -> None:
    """Endings with none and with each of the devices dead."""
    results: dict[str, Any] = {"endings of each": ENDINGS}
    rows = []
    with served_devices() as devices:
        for dead in ("", *OF):
            delays = [delay for _ in range(ENDINGS) for delay in ending(devices, dead)]
            name = f"{dead} dead" if dead else "none dead"
            p50, p99 = (1e3 * float(np.quantile(delays, share)) for share in (0.5, 0.99))
            results[name] = {"p50": p50, "p99": p99, "largest": 1e3 * max(delays), "outputs": len(delays)}
            asked = f"{ASKED:g}" if dead else ""
            rows += [(f"{name}, median, ms", f"{p50:.1f}", ""), (f"{name}, p99, ms", f"{p99:.1f}", asked)]
    table("from a signal to outputs off on the devices alive", [("", "reached", "asked"), *rows])
    print(f"\nkept in {keep(FOLDER, results)}")


def ending(devices: SeveralDevices, dead: str) -> list[float]:
    """The delay of each output of the other devices in one run, s."""
    circuit = devices.circuit
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = shipped("rigs", "oil-circuit-devices.yaml").read_text(encoding="utf-8")
        (folder / "rig.yaml").write_text(patient_devices(text), encoding="utf-8")
        (folder / "endless.yaml").write_text(PROCEDURE, encoding="utf-8")
        (folder / "rigctl.toml").write_text("", encoding="utf-8")
        with begin(folder, "run", "endless.yaml", *devices.options, "--answer-in-browser") as process:
            until(lambda: all(circuit.outputs.values()), process)
            time.sleep(0.5)
            if dead:
                devices.servers[dead].mute = True
            signalled = time.monotonic()
            process.send_signal(signal.SIGTERM)
            alive = [output for device, output in OF.items() if device != dead]
            until(lambda: not any(circuit.outputs[output] for output in alive))
            off = {output: at for at, output, value in circuit.switched if not value and at > signalled}
            if dead:
                devices.servers[dead].mute = False
            process.communicate(timeout=120.0)
        until(lambda: circuit.off)  # the dead one by its guard
        end_guards(folder / "state")
        circuit.switched.clear()
    return [off[output] - signalled for output in alive]


def until(condition: Callable[[], bool], process: subprocess.Popen[str] | None = None) -> None:
    """Wait for a condition."""
    latest = time.monotonic() + 120.0
    while not condition():
        if time.monotonic() > latest or (process is not None and process.poll() is not None):
            raise SystemExit("the bench did not come to that")
        time.sleep(0.001)


if __name__ == "__main__":
    main()
