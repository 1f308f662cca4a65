"""The backend of another package, for a device behind a protocol library: all but its options and client."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl.backends.lines.create import line_bench
from rigctl.backends.options import read_port, refuse_unknown
from rigctl.backends.protocol import Backend
from rigctl.backends.transport.address import Address
from rigctl.backends.transport.client_port import Client, ClientPort
from rigctl.clock import Clock
from rigctl.rig import Rig
from rigctl.rig.protocols.plugin_options import PluginOptions

_KNOWN_AFTER = (
    0.8  # of `wake`, after which a client waits no longer: rigctl, which does, is to know the reason
)


@dataclass(frozen=True)
class PluginBackend:
    """The backend of a package whose device is reached through a protocol library.

    An entry point of ``rigctl.backends`` names one. Its client answers the lines that `PluginOptions` lists;
    polling, read-back, loss and return of the device, safe endings and a guard are rigctl's.

    Attributes
    ----------
    kind: the name of the entry point, which is ``kind`` in a rig file.
    Options: the class that reads ``options`` of a rig file.
    connect: called with the port, the settings of `PluginOptions.client_settings`, and the time of
        `time.monotonic` until which it may wait, s; returns a client, or raises `PortLost`.
    question: what is asked if no port is given, e.g. "where is the MQTT broker?".
    example: a port for that message, e.g. ``192.168.0.40:1883``.
    """

    kind: str
    Options: type[PluginOptions]
    connect: Callable[[str, Mapping[str, Any], float], Client]
    question: str
    example: str

    def create(self, rig: Rig, clock: Clock, options: Mapping[str, object]) -> Backend:
        """Make the bench, not yet open; raises as `address_of`."""
        lines = self.Options.of(rig.backend.plugin).in_lines(rig.actuators)
        return line_bench(rig, lines, clock, self.address_of(rig, options))

    def address_of(self, rig: Rig, options: Mapping[str, object]) -> Address:
        """Return where the device is: what is locked, and opened here or by the guard.

        Raises
        ------
        RigctlError
            an option is unknown or wrong, or no port is given.
        """
        refuse_unknown(f"option of the {self.kind} backend", options, ("port", *self.Options.model_fields))
        port = read_port(rig, options, self.question, f"e.g. '--port {self.example}'")
        folder = Path() if rig.path is None else rig.path.parent
        return Address(self.kind, port, self.Options.of(rig.backend.plugin).client_settings(folder))

    def open_port(self, url: str, settings: Mapping[str, Any], clock: Clock) -> ClientPort:
        """Open the port of an `Address`."""
        # Counted from here, as the first client in a process also imports its library.
        until = time.monotonic() + _KNOWN_AFTER * float(settings["wake"])
        return ClientPort(url, lambda: self.connect(url, settings, until), clock)
