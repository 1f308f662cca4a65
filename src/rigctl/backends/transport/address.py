"""Where a bench is, in a form that its guard can be given: a kind of port, its address and its settings."""

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
    kind: of port: ``serial``, ``modbus``, …
    url: what it is called there.
    settings: whatever else the kind needs; nothing but what JSON holds.
    """

    kind: str
    url: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def open(self, clock: Clock) -> Port:
        """Open it.

        Raises
        ------
        PortLost
            there is no such port now.
        RigctlError
            it may not be opened, or never will be there.
        """
        port: Port = import_module(_OPENERS[self.kind]).open_port(self.url, self.settings, clock)
        return port
