"""The bench of `rigs/oil-circuit-devices.yaml`: servers of three protocols, and one simulated plant."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from protocol_servers import Circuit, ModbusServer, OpcUaServer, ScpiServer, Server
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, load_rig


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
