"""The address of a bench: kind of port, address and settings; it can be passed to the guard."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from rigctl.backends.transport.port import Port
from rigctl.clock import Clock

#: kind of port -> module whose ``open_port(url, settings, clock)`` opens it
_OPENERS: Mapping[str, str] = {
    "serial": "rigctl.backends.transport.pyserial_port",
    "modbus": "rigctl.backends.modbus.client",
    "opcua": "rigctl.backends.opcua.client",
    "visa": "rigctl.backends.visa.client",
}


@dataclass(frozen=True)
class Address:
    """A port that can be opened, here or in the guard's process.

    Parameters
    ----------
    kind: kind of port: ``serial``, ``modbus``, …
    url: its address.
    settings: other settings for this kind of port, JSON-compatible.
    """

    kind: str
    url: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def open(self, clock: Clock) -> Port:
        """Open the port.

        Raises
        ------
        PortLost
            the port does not exist at present.
        RigctlError
            there is no permission, or the address is invalid.
        """
        port: Port = import_module(_OPENERS[self.kind]).open_port(self.url, self.settings, clock)
        return port
