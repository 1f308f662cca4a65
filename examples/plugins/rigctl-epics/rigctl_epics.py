"""EPICS process variables as channels and actuators: Channel Access, through caproto.

`rigctl` makes a whole bench of the client below: polling, read-back, loss and return of the device, a guard.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Mapping
from threading import Thread
from typing import Any

from pydantic import Field

from rigctl import PluginBackend, PluginOptions, PluginOutput, PortLost
from rigctl.backends.transport.readback import as_written
from rigctl.files.name import Name

_INVALID = 3  # the alarm severity of a value that is none
_ENDS_WITHIN = 0.2  # s


class Output(PluginOutput):
    """The process variable of an actuator."""

    set: str = Field(min_length=1, description="the process variable that is written")
    get: str | None = Field(default=None, description="where its state is read; by default the one written")


class Options(PluginOptions):
    """`options` of a rig file with `kind: epics`."""

    channels: dict[Name, str] = Field(description="the process variable of each channel")
    actuators: dict[Name, Output] = Field(default_factory=dict, description="those of each driven actuator")


class EpicsClient:
    """A connection to all process variables of a rig file.

    Raises
    ------
    PortLost
        one of them is not there, or holds no number.
    """

    def __init__(self, url: str, settings: Mapping[str, Any], until: float) -> None:
        from caproto.threading.client import Context

        logging.getLogger("caproto").setLevel(logging.CRITICAL)  # what matters is raised below
        _search_at(url)
        outputs = settings["actuators"].items()
        self._name = url
        self._set = {name: one["set"] for name, one in outputs}
        # what is read, in the order of the answer, and the actuator whose state it is
        self._read = [(variable, "") for variable in settings["channels"].values()]
        self._read += [(one["get"] or one["set"], name) for name, one in outputs]
        self._written: dict[str, str] = {}  # by actuator, the number as it was written
        self._context: Any = Context(timeout=float(settings["timeout"]))
        try:
            wanted = list(dict.fromkeys([*(variable for variable, _ in self._read), *self._set.values()]))
            found = self._context.get_pvs(*wanted)
            self._variables: dict[str, Any] = dict(zip(wanted, found, strict=True))
            self._check(until)
        except BaseException:
            self.close()
            raise

    def answer(self, line: str) -> str | None:
        """Return the answer to ``identify``, ``read 0`` or ``write NAME VALUE``; None without an answer."""
        from caproto import CaprotoError, ErrorResponseReceived

        word, _, rest = line.partition(" ")
        try:
            if word == "identify":
                return f"device {self._name}"
            if word == "read":
                return " ".join(self._number(variable, actuator) for variable, actuator in self._read)
            return self._write(*rest.split(" "))
        except ErrorResponseReceived as refused:
            return f"error {' '.join(str(refused).split())}"
        except TimeoutError:
            for name in self._variables:
                self._connected(name)  # or it is gone
            return None
        except (CaprotoError, OSError, KeyError):  # KeyError: how caproto's read ends with its server
            raise PortLost(f"{self._name}: the EPICS server is gone") from None

    def close(self) -> None:
        """End the connection, without waiting for a search for missing names, which sleeps up to 5 s."""
        ending = Thread(target=self._context.disconnect, daemon=True)
        ending.start()
        ending.join(_ENDS_WITHIN)

    def _check(self, until: float) -> None:
        """Wait for all process variables, and check that each holds a number."""
        variables = self._variables
        while (missing := [name for name, one in variables.items() if not one.connected]) and (
            time.monotonic() < until
        ):
            time.sleep(0.01)
        if len(missing) == len(variables):
            raise PortLost(f"{self._name}: no EPICS server answers")
        if missing:
            raise PortLost(f"{self._name}: no server has {' or '.join(missing)}, the others are there")
        for name, one in variables.items():
            kind = one.channel.native_data_type.name
            if kind in ("STRING", "CHAR") or one.channel.native_data_count != 1:
                raise PortLost(
                    f"{self._name}: {name} holds {one.channel.native_data_count} {kind}, not a number"
                )

    def _connected(self, name: str) -> Any:
        """Return a process variable; caproto would search for a lost one again, and repeat a command then."""
        if not self._variables[name].connected:
            raise PortLost(f"{self._name}: the EPICS server of {name} is gone")
        return self._variables[name]

    def _number(self, variable: str, actuator: str) -> str:
        """Return what a process variable holds; an invalid value is none."""
        found = self._connected(variable).read(data_type="time")
        if found.metadata.severity >= _INVALID:
            return "nan"
        return as_written(float(found.data[0]), self._written.get(actuator))

    def _write(self, actuator: str, text: str) -> str:
        """Write a number, and wait until the server has processed it."""
        from caproto import AccessRights

        variable = self._connected(self._set[actuator])
        if not variable.access_rights & AccessRights.WRITE:
            return f"error {variable.name} can only be read"
        number = float(text)
        whole = variable.channel.native_data_type.name not in ("FLOAT", "DOUBLE")
        status = variable.write([round(number) if whole else number]).status
        if not status.success:
            return f"error {self._set[actuator]}: {status.description}"
        self._written[actuator] = text
        return "ok"


def _search_at(address: str) -> None:
    """Add an address to those at which this process searches: names are unique in an EPICS network."""
    known = os.environ.get("EPICS_CA_ADDR_LIST", "").split()
    if address not in known:
        os.environ["EPICS_CA_ADDR_LIST"] = " ".join([*known, address])
        os.environ.setdefault("EPICS_CA_AUTO_ADDR_LIST", "NO")


BACKEND = PluginBackend("epics", Options, EpicsClient, "where is the EPICS server?", "192.168.0.30:5064")
