"""The address of a bench: kind of port, address and settings; it can be passed to the guard.

All spellings of one address have the same key, which locks and guards use.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from json import dumps
from typing import Any

from rigctl.backends.transport.address_key import address_key
from rigctl.backends.transport.port import Port
from rigctl.clock import Clock
from rigctl.plugins import BACKENDS, load_plugin

#: kind of port -> module whose ``open_port(url, settings, clock)`` opens it
_OPENERS: Mapping[str, str] = {
    "serial": "rigctl.backends.transport.pyserial_port",
    "modbus": "rigctl.backends.modbus.client",
    "opcua": "rigctl.backends.opcua.client",
    "visa": "rigctl.backends.visa.client",
    "python": "rigctl.backends.python.client",
}


#: kinds of addresses that may be serial ports of this computer
SERIAL = ("serial", "modbus")


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

    @cached_property
    def key(self) -> str:
        """The device that is reached, the same for all spellings of its address.

        On Modbus TCP each unit is a device of its own: a gateway has several. A driver without a port is told
        by its arguments which device it has.
        """
        if self.kind == "python" and not self.settings["port"]:
            return f"driver {self.url} {dumps(self.settings['arguments'], sort_keys=True)}"
        key = address_key(self.kind, self.url)
        unit = self.settings.get("unit")
        return f"{key} unit {unit}" if self.kind == "modbus" and key.startswith("tcp ") else key

    def same_place(self, url: str) -> bool:
        """Return whether another address of this kind names the same place."""
        return address_key(self.kind, url) == address_key(self.kind, self.url)

    def open(self, clock: Clock) -> Port:
        """Open the port.

        Raises
        ------
        PortLost
            the port does not exist at present.
        RigctlError
            there is no permission, or the address is invalid.
        """
        known = self.kind in _OPENERS
        opener = import_module(_OPENERS[self.kind]) if known else load_plugin(BACKENDS, self.kind)
        port: Port = opener.open_port(self.url, self.settings, clock)
        return port
