"""The bench of `rigs/oil-circuit-devices.yaml`: servers of three protocols, and one simulated plant."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from protocol_servers import Circuit, ModbusServer, OpcUaServer, ScpiServer, Server
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig

#: s by which the readings of each device are old
AGES = {"controller": 0.25, "plant": 0.1, "meter": 0.4}
#: what a rig file says of the edge that all of them see
ALIGN = """
align:
  actuator: relief_valve
  to: 30 bar
  channels: [oil_temperature, supply_pressure, line_temperature]
  hold: 2 s
  repeats: 5
clocks:
  lab: {channels: [line_temperature], uncertainty: 1 s}  # not yet measured
"""


class _Meter(ScpiServer):
    switch, temperature = "cooler", "line_temperature"


@dataclass
class SeveralDevices:
    """The plant, and the server of each device by its name in the rig file."""

    circuit: Circuit
    servers: dict[str, Server]

    @property
    def addresses(self) -> dict[str, str]:
        return {name: server.port for name, server in self.servers.items()}

    @property
    def options(self) -> list[str]:
        """Those of a command that name the devices' addresses."""
        return [word for name, port in self.addresses.items() for word in ("--port", f"{name}={port}")]


@contextmanager
def served_devices(rig: Rig | None = None) -> Iterator[SeveralDevices]:
    """Serve the three devices of the rig."""
    rig = rig or load_rig(shipped("rigs", "oil-circuit-devices.yaml"))
    circuit = Circuit(rig)
    kinds = {"controller": ModbusServer, "plant": OpcUaServer, "meter": _Meter}
    with ExitStack() as stack:
        servers = {name: stack.enter_context(make(rig, circuit)) for name, make in kinds.items()}
        yield SeveralDevices(circuit, servers)


def patient_devices(text: str, stale_after: str = "60 s") -> str:
    """The rig file with limits that a busy computer, or one that stalls for seconds, does not exceed."""
    text = re.sub(r"^      (wake|watchdog|tries): .*\n", "", text, flags=re.MULTILINE)
    limits = "      timeout: 4 s\n      tries: 1\n      wake: 60 s\n      watchdog: 30 s\n"
    text, devices = re.subn(r"^      timeout: .*\n", limits, text, flags=re.MULTILINE)
    text, limits_found = re.subn(
        r"^( *)stale_after: [\d.]+ s", rf"\1stale_after: {stale_after}", text, flags=re.MULTILINE
    )
    assert (devices, limits_found) == (3, 2)
    return text


class Wired:
    """The circuit for one device: its sensors are wired to the relief valve, and read late."""

    def __init__(self, circuit: Circuit, age: float) -> None:
        self._circuit, self.age = circuit, age
        self.connected = True

    def __getattr__(self, name: str) -> Any:
        return getattr(self._circuit, name)

    def read(self) -> dict[str, float]:
        then = time.monotonic() - self.age
        switched = [
            value for at, name, value in self._circuit.switched if name == "relief_valve" and at <= then
        ]
        on = self.connected and bool(switched and switched[-1])
        temperature = 293.15 + 20.0 * on
        return self._circuit.read() | {
            "oil_temperature": temperature,
            "line_temperature": temperature,
            "supply_pressure": 30e5 * on,
        }


@contextmanager
def wired_devices() -> Iterator[SeveralDevices]:
    """The three servers, whose sensors see the relief valve, each as old as `AGES` says."""
    with served_devices() as served:
        for name, server in served.servers.items():
            server.circuit = Wired(served.circuit, AGES[name])  # type: ignore[assignment]
        yield served
