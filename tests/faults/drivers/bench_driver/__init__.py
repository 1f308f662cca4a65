"""A driver package as a user has it: it knows nothing of rigctl, and speaks to a real TCP server."""

from __future__ import annotations

import ctypes
import os
import socket
import sys
import time
from pathlib import Path

#: a function of a library in C that keeps the interpreter's lock meanwhile
_SLEEP = ctypes.PyDLL(None).sleep if os.name == "posix" else ctypes.PyDLL("kernel32").Sleep  # type: ignore[arg-type]


class Quantity:
    """A number with its unit, as several driver packages return it."""

    def __init__(self, magnitude: float, units: str) -> None:
        self.magnitude, self.units = magnitude, units


class Unit:
    """A switch and measurement unit.

    `faults` is a file that says how the driver misbehaves from then on; `process` is where it writes its
    process id.
    """

    def __init__(self, address: str, faults: str, process: str) -> None:
        print("a driver that talks")  # noqa: T201 - it must not disturb
        exclusive = Path(process).with_name("exclusive")
        if exclusive.exists():  # as a serial port: nobody else has it while this process lives
            self._held = socket.create_server(("127.0.0.1", int(exclusive.read_text(encoding="utf-8"))))
        Path(process).write_text(str(os.getpid()), encoding="utf-8")
        Path(process).with_name("guard").write_text(str(os.getppid()), encoding="utf-8")
        host, _, port = address.rpartition(":")
        self._faults = Path(faults)
        self._hung = Path(process).with_name("hung")
        self._line = socket.create_connection((host, int(port)), timeout=60.0).makefile("rw", newline="\n")

    def _ask(self, text: str) -> str:
        self._line.write(f"{text}\n")
        self._line.flush()
        return self._line.readline().strip()

    @property
    def idn(self) -> str:
        return self._ask("*IDN?")

    @property
    def pressure(self) -> object:
        volts = self._volts()[0]
        fault = self._faults.read_text(encoding="utf-8")
        self._fail(fault)
        other_unit = Quantity(1e3 * volts, "mV")
        wrong = {"text": "ERR 7", "nothing": None, "array": [volts, volts], "unit": other_unit}
        return wrong.get(fault, Quantity(volts, "V"))

    def measure(self) -> dict[str, float]:
        """All readings, in mV."""
        pressure, temperature = self._volts()
        fault = self._faults.read_text(encoding="utf-8")
        if fault.startswith("temperature "):
            self._fail(fault.removeprefix("temperature "))
        return {"pressure": 1e3 * pressure, "temperature": 1e3 * temperature}

    def _fail(self, fault: str) -> None:
        if fault == "raises":
            raise OSError("the instrument is offline")
        if fault.startswith("hangs"):
            self._hung.touch()
            if fault == "hangs, and nothing else runs":
                _SLEEP(3600 if os.name == "posix" else 3_600_000)
            time.sleep(3600.0)
        if fault == "ends":
            sys.exit(3)
        if fault == "dies":
            os.kill(os.getpid(), 9)

    def _volts(self) -> list[float]:
        return [float(text) for text in self._ask("MEAS:VOLT:DC? (@101,102)").split(",")]

    @property
    def relay(self) -> bool:
        return self._ask("ROUT:CLOS? (@201)") == "1"

    @relay.setter
    def relay(self, closed: bool) -> None:
        self._ask(f"ROUT:{'CLOS' if closed else 'OPEN'} (@201);*OPC?")

    @property
    def output(self) -> float:
        """The analog output in V."""
        return float(self._ask("SOUR:VOLT? (@202)"))

    def set_output(self, volts: float) -> None:
        self._ask(f"SOUR:VOLT {volts:.6f},(@202);*OPC?")

    def shutdown(self) -> None:
        self.relay = False


def not_a_class() -> None:
    """Something that a rig file must not call."""
    raise AssertionError("it was called")
